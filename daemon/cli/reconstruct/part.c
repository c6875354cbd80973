#include "daemon/cli/reconstruct/part.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "base/file.h"
#include "daemon/volumes/join.h"

#define EARLY \
    5 /* sets: after these a volume no longer depends on where a warm start or temporal term began */

/* Hash of the masks' contents, because the rig has only their names.  0: no masks. */
static uint64_t hash_masks(const struct rec_rig *rig, const dmn_photometry *light)
{
    uint64_t h = 0;
    for (size_t c = 0; c < rig->n_cameras; c++) {
        const struct cap_photometry *of = dmn_photometry_of(light, c);
        size_t n = (size_t)rig->cameras[c].width * (size_t)rig->cameras[c].height;
        if (of != NULL && of->mask != NULL)
            h = XXH3_64bits_withSeed(of->mask, n, h + c);
    }
    return h;
}

static pvx_err hash_background(const char *dir, const struct rec_rig *rig, uint64_t *h,
                               struct pvx_diag *d)
{
    *h = 0;
    for (size_t c = 0; c < rig->n_cameras && dir != NULL; c++) {
        char path[PATH_MAX];
        uint64_t one[2] = {*h, 0};
        if (frames_in_background_file(dir, rig->cameras[c].name, path, sizeof path, NULL) != PVX_OK)
            continue; /* reported when it is read */
        PVX_TRY(dmn_photometry_hash(path, &one[1], d));
        *h = XXH3_64bits(one, sizeof one);
    }
    return PVX_OK;
}

static pvx_err name_job(struct reconstruct_part *p, const struct reconstruct_options *o,
                        const struct rec_rig *rig, const struct frames_in *in, struct pvx_diag *d)
{
    char *text;
    size_t len;
    if ((uint64_t)in->number[in->n - 1] > PARTS_NUMBER_MAX)
        return pvx_fail(d, PVX_ERANGE, "%s: frame number %lld is too large for a job in parts",
                        o->frames, (long long)in->number[in->n - 1]);
    uint64_t *number = malloc(in->n * sizeof *number);
    pvx_err e = number != NULL ? rec_rig_format(rig, &text, &len) : PVX_ENOMEM;
    if (e != PVX_OK) {
        free(number);
        return e;
    }
    memcpy(number, in->number, in->n * sizeof *number);
    char *options = NULL, real[PATH_MAX], what[PATH_MAX + 40], within[120] = "";
    uint64_t masks = hash_masks(rig, in->light), background;
    e = hash_background(o->background, rig, &background, d);
    if (masks != 0)
        snprintf(within, sizeof within, "in the masks: %016llx\n", (unsigned long long)masks);
    if (background != 0)
        snprintf(within + strlen(within), sizeof within - strlen(within),
                 "in --background: %016llx\n", (unsigned long long)background);
    if (in->take != NULL)
        snprintf(what, sizeof what, "take of session %016llx",
                 (unsigned long long)cap_take_info(in->take)->head.session);
    else
        snprintf(what, sizeof what, "%s",
                 realpath(o->frames, real) != NULL ? basename(real) : o->frames);
    if (asprintf(&options, "%s--frames %s\n%s", o->said, what, within) < 0)
        options = NULL;
    p->job = (struct parts_job){.out = o->out,
                                .n = o->parts,
                                .rig = text,
                                .options = options,
                                .number = number,
                                .n_sets = in->n};
    if (e != PVX_OK || p->job.options == NULL)
        return e != PVX_OK ? e : PVX_ENOMEM;
    if (o->parts > in->n)
        return pvx_fail(d, PVX_EINVAL, "%u parts, but there are only %zu frame sets", o->parts,
                        in->n);
    return parts_begin(&p->job, d);
}

/* Refuse a take that still grows: a moment later it would be divided differently. */
static pvx_err part_is_whole(const struct reconstruct_options *o, const struct frames_in *in,
                             struct pvx_diag *d)
{
    if (in->take == NULL || cap_take_info(in->take)->closed || o->last < FRAMES_IN_LAST)
        return PVX_OK;
    return pvx_fail(d, PVX_EBUSY,
                    "%s: is still being written, or was cut off: wait for its end, or name "
                    "the last set with --last (now %lld)",
                    o->frames, (long long)in->number[in->n - 1]);
}

pvx_err reconstruct_part_begin(struct reconstruct_part *p, const struct reconstruct_options *o,
                               const struct rec_rig *rig, struct frames_in *in, struct pvx_diag *d)
{
    char path[4400];
    size_t first, end;
    p->said = o->said;
    if (o->parts == 0) {
        p->path = strdup(o->out);
        return p->path != NULL ? vol_writer_check(VOL_HDF5, o->out, d) : PVX_ENOMEM;
    }
    PVX_TRY(vol_join_check(o->out, d)); /* not when all is solved */
    PVX_TRY(part_is_whole(o, in, d));
    PVX_TRY(name_job(p, o, rig, in, d));
    if (o->part == 0) /* other processes take the parts (slurm.h) */
        return PVX_OK;
    PVX_TRY(part_take(&p->job, o->part, o->resume, &p->nothing, &p->part, d));
    parts_path(&p->job, o->part, "h5", path, sizeof path);
    p->path = strdup(path);
    if (p->path == NULL)
        return PVX_ENOMEM;
    parts_run(in->n, o->part, o->parts, &first, &end);
    p->own = (uint64_t)in->number[first];
    p->early = o->warm || o->frame.temporal ? first < EARLY ? first : EARLY : 0;
    frames_in_only(in, first - p->early, end);
    return PVX_OK;
}

static bool part_is_there(const char *path)
{
    return access(path, F_OK) == 0;
}

/* Volumes of an earlier try go into the new file first.  The old file is kept until all of them are copied. */
static pvx_err part_take_over(struct reconstruct_part *p, const struct rec_rig *rig,
                              const struct frames_in *in, uint64_t *last, struct pvx_diag *d)
{
    char aside[4500];
    snprintf(aside, sizeof aside, "%.*s.cut-off", (int)sizeof aside - 20, p->path);
    if (p->part != NULL && part_is_there(p->path) && !part_is_there(aside) &&
        rename(p->path, aside) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", p->path, strerror(errno));
    if (p->part != NULL && part_is_there(aside) &&
        part_is_there(p->path)) /* that copy was not finished */
        unlink(p->path);
    PVX_TRY(volumes_out_new(p->path, rig, in->nch, p->part != NULL ? parts_session(&p->job) : 1,
                            p->said, &p->out, d));
    if (p->part == NULL || !part_is_there(aside))
        return PVX_OK;
    struct pvx_diag why = {""};
    pvx_err e = volumes_out_copy(p->out, aside, &p->copied, last, &why);
    if (e == PVX_EFORMAT || e == PVX_ENOENT || e == PVX_ECORRUPT) { /* it died at its beginning */
        fprintf(stderr, "pyrovox: %s; solved again from there\n", pvx_diag_text(&why, e));
        e = PVX_OK;
    }
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
    PVX_TRY(pvx_file_sync(p->path, d));
    unlink(aside);
    return PVX_OK;
}

pvx_err reconstruct_part_open(struct reconstruct_part *p, const struct rec_rig *rig,
                              struct frames_in *in, struct pvx_diag *d)
{
    uint64_t last = 0;
    size_t own = 0;
    PVX_TRY(part_take_over(p, rig, in, &last, d));
    p->done = p->copied;
    if (p->part != NULL)
        part_begin(p->part, p->done);
    if (p->copied == 0)
        return PVX_OK;
    fprintf(stderr, "pyrovox: part of an earlier try: %llu of %zu sets are there\n",
            (unsigned long long)p->copied, in->n - p->early);
    while (own < in->n && (uint64_t)in->number[own] <= last)
        own++;
    if (own == in->n) { /* all sets are done: the file is only closed */
        frames_in_only(in, 0, 0);
        return PVX_OK;
    }
    p->own = (uint64_t)in->number[own];
    frames_in_only(in, own > p->early ? own - p->early : 0, in->n);
    return PVX_OK;
}

/* Write the volume before the part's first own one, as this part has it. */
static pvx_err put_seam(struct reconstruct_part *p, const struct dmn_slot *s,
                        const struct rec_rig *rig, int nch, struct pvx_diag *d)
{
    char path[4500];
    volumes_out *seam;
    snprintf(path, sizeof path, "%.*s.seam.h5", (int)strlen(p->path) - 3, p->path);
    unlink(path);
    PVX_TRY(volumes_out_new(path, rig, nch, parts_session(&p->job), p->said, &seam, d));
    pvx_err e = volumes_out_put(seam, s, d), closing = volumes_out_close(&seam, d);
    return e == PVX_OK ? closing : e;
}

pvx_err reconstruct_part_put(struct reconstruct_part *p, const struct dmn_slot *s,
                             const struct rec_rig *rig, int nch, bool *own, struct pvx_diag *d)
{
    *own = p->part == NULL || s->set >= p->own;
    if (!*own) {
        bool seam = p->copied == 0 && --p->early == 0 && s->why == DMN_N_DROP;
        return seam ? put_seam(p, s, rig, nch, d) : PVX_OK;
    }
    PVX_TRY(volumes_out_put(p->out, s, d));
    p->done += s->why == DMN_N_DROP;
    if (p->part != NULL)
        part_say(p->part, PART_RUNNING, p->done, NULL);
    return PVX_OK;
}

pvx_err reconstruct_part_end(struct reconstruct_part *p, pvx_err e, struct pvx_diag *d)
{
    pvx_err closing = volumes_out_close(&p->out, d);
    e = e == PVX_OK ? closing : e;
    if (e == PVX_OK && p->part != NULL && !p->nothing)
        e = pvx_file_sync(p->path, d);
    if (p->part != NULL && !p->nothing)
        part_say(p->part,
                 e == PVX_OK          ? PART_DONE
                 : e == PVX_ECANCELED ? PART_STOPPED
                                      : PART_FAILED,
                 p->done, e == PVX_OK ? NULL : pvx_diag_text(d, e));
    part_free(&p->part);
    if (p->job.number != NULL)
        parts_free(&p->job);
    free(p->path);
    p->path = NULL;
    return e;
}
