#include "proto/fields.h"

#include <math.h>

size_t pvp_grid_count(const struct pvp_grid *g)
{
    return (size_t)g->n[0] * g->n[1] * g->n[2] * g->channels;
}

bool pvp_grid_valid(const struct pvp_grid *g)
{
    for (int a = 0; a < 3; a++)
        if (g->n[a] < 1 || g->n[a] > PVP_GRID_MAX || !isfinite(g->min[a]) || !isfinite(g->max[a]) ||
            !(g->min[a] < g->max[a]))
            return false;
    return g->basis <= 1 && (g->channels == 1 || g->channels == 3);
}

pvx_err pvp_grid_fail(const struct pvp_grid *g, struct pvx_diag *d)
{
    return pvx_fail(d, PVX_EFORMAT,
                    "message's grid is outside the format's limits: %u x %u x %u, basis %u, "
                    "%u channels",
                    g->n[0], g->n[1], g->n[2], g->basis, g->channels);
}

bool pvp_grid_same(const struct pvp_grid *a, const struct pvp_grid *b)
{
    for (int i = 0; i < 3; i++)
        if (a->n[i] != b->n[i] || a->min[i] < b->min[i] || a->min[i] > b->min[i] ||
            a->max[i] < b->max[i] || a->max[i] > b->max[i])
            return false;
    return a->basis == b->basis && a->channels == b->channels;
}

uint32_t pvp_grid_bricks(const struct pvp_grid *g, uint32_t nb[3])
{
    for (int a = 0; a < 3; a++)
        nb[a] = (g->n[a] + PVP_BRICK - 1) / PVP_BRICK;
    return nb[0] * nb[1] * nb[2];
}

size_t pvp_sample_size(enum pvp_sample s)
{
    return s == PVP_F16 ? 2 : 4;
}

void pvp_header_fields(struct wire *w, struct pvp_header *h, uint64_t *body)
{
    uint32_t type = h->type, head = (uint32_t)h->head;
    uint32_t major = h->version >> 16, minor = h->version & 0xffff;
    wire_u16(w, &type);
    wire_u16(w, &head);
    wire_u16(w, &major);
    wire_u16(w, &minor);
    wire_u32(w, &h->flags);
    wire_u64(w, &h->sequence);
    wire_u64(w, &h->type_sequence);
    wire_u64(w, &h->session);
    wire_u64(w, body);
    h->type = (enum pvp_type)type;
    h->head = head;
    h->version = major << 16 | minor;
}

void pvp_grid_fields(struct wire *w, struct pvp_grid *g)
{
    for (int a = 0; a < 3; a++)
        wire_u32(w, &g->n[a]);
    wire_u32(w, &g->basis);
    wire_u32(w, &g->channels);
}

void pvp_box_fields(struct wire *w, struct pvp_grid *g)
{
    for (int a = 0; a < 3; a++)
        wire_f64(w, &g->min[a]);
    for (int a = 0; a < 3; a++)
        wire_f64(w, &g->max[a]);
}

static void report_fields(struct wire *w, struct pvp_report *r)
{
    wire_u32(w, &r->status);
    wire_u32(w, &r->iterations);
    wire_text(w, r->solver, sizeof r->solver);
    wire_f64(w, &r->rel_residual);
    wire_u32(w, &r->active_voxels);
    wire_u32(w, &r->active_rays);
    wire_u64(w, &r->entries);
    wire_i64(w, &r->photometry_ns);
    wire_i64(w, &r->hull_ns);
    wire_i64(w, &r->restrict_ns);
    wire_i64(w, &r->solve_ns);
    wire_i64(w, &r->total_ns);
}

void pvp_volume_fields(struct wire *w, struct pvp_volume *v, struct pvp_payload *p)
{
    wire_u32(w, &p->description);
    wire_u32(w, &p->sample);
    wire_u32(w, &p->comp);
    wire_u32(w, &p->side);
    wire_u64(w, &v->set);
    wire_i64(w, &v->t_exposure_ns);
    wire_i64(w, &v->t_publish_ns);
    wire_i64(w, &v->spread_ns);
    wire_i64(w, &v->latency_ns);
    wire_u64(w, &v->camera_mask);
    wire_u32(w, &v->cameras_present);
    pvp_grid_fields(w, &v->grid);
    pvp_box_fields(w, &v->grid);
    report_fields(w, &v->report);
    wire_u32(w, &p->n_bricks);
    wire_u32(w, &p->doubt);
    wire_u64(w, &p->raw_len);
    wire_u64(w, &p->stored);
}
