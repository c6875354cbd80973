#include "daemon/cli/reconstruct/volumes_out.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/cli/common/cli.h"
#include "daemon/pipeline/wire.h"
#include "daemon/volumes/bricks.h"

struct volumes_out {
    vol_writer *w;
    struct pvp_start start;
    struct vol_store store, bars, mode;
    float *modes; /* [n_modes][bricks][8^3][channels] */
    size_t floats;
};

/* The options as comments of YAML, so that the recording says how it was made; NULL: no memory. */
static char *volumes_out_options(const char *options)
{
    char *text = NULL;
    size_t len;
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        return NULL;
    fputs(VOLUMES_OUT_OPTIONS, f);
    for (const char *at = options; *at != '\0';) {
        size_t n = strcspn(at, "\n");
        fprintf(f, "# %.*s\n", (int)n, at);
        at += n + (at[n] == '\n');
    }
    if (fclose(f) == 0)
        return text;
    free(text);
    return NULL;
}

pvx_err volumes_out_new(const char *path, const struct rec_rig *rig, int nch, uint64_t session,
                        const char *options, volumes_out **out, struct pvx_diag *d)
{
    char *text;
    size_t len;
    *out = NULL;
    volumes_out *o = pvx_calloc(1, sizeof *o);
    PVX_NEED(o);
    dmn_wire_start(rig, nch, 0, "pyrovox", &o->start);
    o->start.session = session;
    pvx_err e = rec_rig_format(rig, &text, &len);
    if (e == PVX_OK) {
        char *config = volumes_out_options(options);
        struct vol_head head = {.start = o->start, .rig = text, .config = config};
        e = vol_writer_open(VOL_HDF5, path, &head, NULL, &o->w, d);
        free(config);
        free(text);
    }
    if (e == PVX_OK)
        *out = o;
    else
        free(o);
    return e;
}

pvx_err volumes_out_copy(volumes_out *o, const char *from, uint64_t *n, uint64_t *last,
                         struct pvx_diag *d)
{
    vol_reader *r;
    struct vol_volume v;
    const struct vol_gap *g;
    *n = 0;
    PVX_TRY(vol_reader_open(from, &r, d));
    vol_reader_modes(r, true);
    const struct pvp_start *s = &vol_reader_head(r)->start;
    pvx_err e = s->session == o->start.session && s->rig_hash == o->start.rig_hash &&
                        pvp_grid_same(&s->grid, &o->start.grid)
                    ? PVX_OK
                    : pvx_fail(d, PVX_ESTALE, "%s: is of another rig or grid", from);
    for (uint64_t k = 0; k < vol_reader_count(r) && e == PVX_OK; k++) {
        e = cli_stop ? PVX_ECANCELED : vol_reader_get(r, k, &v, d);
        PVX_THEN(e, vol_writer_put(o->w, &v, d));
        if (e == PVX_OK) {
            *last = v.v.set;
            ++*n;
        }
    }
    for (uint64_t k = 0; e == PVX_OK && (g = vol_reader_gap(r, k)) != NULL; k++)
        e = vol_writer_gap(o->w, g, d);
    vol_reader_close(&r);
    return e;
}

/* Error bars of the slot on the bricks of v. */
static pvx_err volumes_out_bars(volumes_out *o, const struct dmn_slot *s, struct vol_volume *v)
{
    const struct pvp_grid *g = &o->start.grid;
    const struct rec_bars_view *b = &s->bars;
    struct pvp_voxels x;
    size_t one = (size_t)v->n_bricks * PVP_BRICK * PVP_BRICK * PVP_BRICK * g->channels;
    if (!dmn_wire_bars(s, &x, &v->bars.doubt))
        return PVX_OK;
    PVX_TRY(vol_from_voxels(&o->bars, g, &x));
    if (b->n_modes * one > o->floats) {
        free(o->modes);
        o->floats = 0;
        o->modes = malloc(b->n_modes * one * sizeof *o->modes);
        PVX_NEED(o->modes);
        o->floats = b->n_modes * one;
    }
    for (uint32_t k = 0; k < b->n_modes; k++) {
        x.value = b->modes + (size_t)k * (size_t)b->n * (size_t)b->cs;
        PVX_TRY(vol_from_voxels(&o->mode, g, &x));
        memcpy(o->modes + k * one, o->mode.brick, one * sizeof *o->modes);
    }
    v->bars.sd = o->bars.brick;
    v->bars.n_modes = b->n_modes;
    v->bars.modes = o->modes;
    return PVX_OK;
}

pvx_err volumes_out_put(volumes_out *o, const struct dmn_slot *s, struct pvx_diag *d)
{
    const struct vol_gap gap = {VOL_GAP_UNREADABLE, s->set, s->set, 1};
    struct vol_volume v = {.sample = PVP_F32};
    struct pvp_voxels x;
    if (s->why != DMN_N_DROP)
        return vol_writer_gap(o->w, &gap, d);
    dmn_wire_volume(s, &o->start.grid, &v.v, &x);
    v.v.session = o->start.session;
    pvx_err e = vol_from_voxels(&o->store, &o->start.grid, &x);
    v.n_bricks = o->store.n;
    PVX_THEN(e, volumes_out_bars(o, s, &v));
    if (e != PVX_OK)
        return pvx_fail(d, e, "frame %06llu: %s", (unsigned long long)s->set,
                        e == PVX_ENOMEM ? "no memory for its volume" : "a value is not finite");
    v.ids = o->store.ids;
    v.brick = o->store.brick;
    return vol_writer_put(o->w, &v, d);
}

pvx_err volumes_out_close(volumes_out **op, struct pvx_diag *d)
{
    volumes_out *o = *op;
    if (o == NULL)
        return PVX_OK;
    pvx_err e = vol_writer_close(&o->w, d);
    vol_store_free(&o->store);
    vol_store_free(&o->bars);
    vol_store_free(&o->mode);
    free(o->modes);
    PVX_FREE(*op);
    return e;
}
