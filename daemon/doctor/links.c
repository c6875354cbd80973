/* links.c - which interfaces the cameras are on. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/parse.h"

#define MAX_ROUTES 256

static struct doc_link *link_of(struct doctor *d, const char *name)
{
    for (size_t i = 0; i < d->n_links; i++)
        if (strcmp(d->link[i].name, name) == 0)
            return &d->link[i];
    if (d->n_links == DOC_MAX_LINKS)
        return NULL;
    struct doc_link *l = &d->link[d->n_links++];
    *l = (struct doc_link){.loopback = strcmp(name, "lo") == 0};
    snprintf(l->name, sizeof l->name, "%s", name);
    return l;
}

static void no_route(struct doctor *d, const struct doc_load_camera *k, const struct doc_route *r)
{
    unsigned a = k->address;
    struct doc_finding *f = doc_say(
        d, DOC_FAIL, 100, "net.route", "%s (%u.%u.%u.%u) is not on a network of this host%s%s",
        k->name, a >> 24, a >> 16 & 255, a >> 8 & 255, a & 255,
        r != NULL ? ", only behind the router on " : "", r != NULL ? r->iface : "");
    doc_means(f, "the camera is never found: discovery and streams do not pass a router");
    doc_command(f, "ip address add %u.%u.%u.1/24 dev INTERFACE", a >> 24, a >> 16 & 255,
                a >> 8 & 255);
    doc_note(f, "or give the camera an address of a network that this host has: "
                "arv-tool-0.8 and the maker's tool can set it");
}

/* The interface of the longest prefix that holds the address. */
static void links_place(struct doctor *d, const struct doc_load_camera *k,
                        const struct doc_route *r, size_t n)
{
    const struct doc_route *best = NULL;
    for (size_t i = 0; i < n; i++)
        if ((k->address & r[i].mask) == (r[i].dest & r[i].mask) &&
            (best == NULL || r[i].mask > best->mask))
            best = &r[i];
    bool local = k->address >> 24 == 127;
    if (!local && (best == NULL || best->gateway != 0)) {
        no_route(d, k, best);
        return;
    }
    struct doc_link *l = link_of(d, local ? "lo" : best->iface);
    if (l == NULL)
        return;
    l->certain = true;
    l->cameras++;
    l->bytes_per_s += (double)k->frame_bytes * d->load.fps;
    l->address = k->address;
}

/* Cameras known by name only may be on any card that has a cable in it. */
static void all_cards(struct doctor *d)
{
    struct doc_names *names = doc_names(d->host, "/sys/class/net");
    if (names == NULL)
        return;
    for (size_t i = 0; i < names->n; i++) {
        int64_t type, carrier;
        if (doc_int(d->host, &type, "/sys/class/net/%s/type", names->v[i]) && type == 1 &&
            doc_exists(d->host, "/sys/class/net/%s/device", names->v[i]) &&
            doc_int(d->host, &carrier, "/sys/class/net/%s/carrier", names->v[i]) && carrier == 1 &&
            strlen(names->v[i]) < sizeof d->link[0].name)
            link_of(d, names->v[i]);
    }
    free(names);
    if (d->n_links == 0) {
        struct doc_finding *f = doc_say(d, DOC_FAIL, 99, "net.carrier",
                                        "no network card here has a cable with life in it");
        doc_means(f, "no GigE camera can be reached");
        doc_note(f, "plug the cameras' cable in, or `ip link set INTERFACE up`");
    }
}

void doc_find_links(struct doctor *d)
{
    bool anywhere = false;
    char *text = doc_file(d->host, "/proc/net/route");
    struct doc_route *r = calloc(MAX_ROUTES, sizeof *r);
    size_t n = text != NULL && r != NULL ? doc_parse_routes(text, r, MAX_ROUTES) : 0;
    d->n_links = 0;
    for (size_t i = 0; i < d->load.n && r != NULL; i++) {
        const struct doc_load_camera *k = &d->load.camera[i];
        if (k->kind != DOC_CAM_GIGE)
            continue;
        if (k->address != 0)
            links_place(d, k, r, n);
        else
            anywhere = true;
    }
    if (anywhere)
        all_cards(d);
    free(text);
    free(r);
}
