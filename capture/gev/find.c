#include "capture/gev/find.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "capture/gev/err.h"
#include "capture/gev/genicam.h"
#include "capture/gev/last.h"
#include "capture/wire/be.h"
#include "capture/wire/gvcp.h"

#define PROBES            2
#define PROBE_MS          150
#define FIRST_NUMBER      0x0B00
#define CHANNEL_PRIVILEGE 0x0A00 /* register: whether a program controls the camera */
#define REMEMBERED        64
#define XML_URL           0x0200 /* two registers with the place of the GenICam file: this and the next */
#define XML_URL_SIZE      512
#define XML_MAX           (64u << 20)

/* ---- asking a camera ----------------------------------------------------------------------------- */

static void find_copy_text(char *out, size_t size, const uint8_t *p)
{
    size_t n = strnlen((const char *)p, size - 1);
    memcpy(out, p, n);
    out[n] = '\0';
}

/* A command to one address. */
struct question {
    uint16_t command, number;
    const void *data; /* n bytes, NULL = none */
    size_t n;
};

/* Send the question, and wait for an answer with at least `size` bytes of payload.  Other packets are ignored. */
static bool find_ask(int fd, const struct question *q, uint8_t *out, size_t size)
{
    uint8_t p[CAP_GVCP_MAX];
    size_t n = cap_gvcp_put_command(p, CAP_GVCP_ACK, q->command, q->number, q->data, q->n);
    if (send(fd, p, n, 0) != (ssize_t)n)
        return false;
    int64_t until = pvx_now_mono() + PROBE_MS * PVX_NS_PER_MS;
    for (int64_t left; (left = until - pvx_now_mono()) > 0;) {
        struct pollfd pfd = {.fd = fd, .events = POLLIN};
        struct cap_gvcp_answer a;
        if (poll(&pfd, 1, (int)(left / PVX_NS_PER_MS) + 1) <= 0)
            continue;
        ssize_t got = recv(fd, p, sizeof p, 0);
        if (got < 0)
            return false; /* refused: a host is there, but no camera */
        if (!cap_gvcp_parse_ack(p, (size_t)got, &a) || a.status != CAP_GVCP_OK ||
            a.command != q->command + 1 || a.id != q->number || a.n < size)
            continue;
        memcpy(out, a.data, size);
        return true;
    }
    return false;
}

static bool ask_address(uint32_t address, struct question q, uint8_t *out, size_t size)
{
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(CAP_GVCP_PORT)};
    to.sin_addr.s_addr = htonl(address);
    bool got = false;
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return false;
    if (connect(fd, (const struct sockaddr *)&to, sizeof to) == 0)
        for (uint16_t i = 0; i < PROBES && !got; i++) {
            q.number = (uint16_t)(FIRST_NUMBER + i);
            got = find_ask(fd, &q, out, size);
        }
    close(fd);
    return got;
}

bool aravis_probe(uint32_t address, struct aravis_who *who)
{
    uint8_t p[CAP_GVCP_DISCOVER];
    if (!ask_address(address, (struct question){.command = CAP_GVCP_DISCOVERY}, p, sizeof p))
        return false;
    if (who != NULL) {
        find_copy_text(who->vendor, sizeof who->vendor, p + 72);
        find_copy_text(who->model, sizeof who->model, p + 104);
        find_copy_text(who->serial, sizeof who->serial, p + 216);
        find_copy_text(who->name, sizeof who->name, p + 232);
    }
    return true;
}

bool aravis_controlled(uint32_t address)
{
    uint8_t reg[4], value[4];
    cap_put32(reg, CHANNEL_PRIVILEGE);
    struct question q = {.command = CAP_GVCP_READREG, .data = reg, .n = sizeof reg};
    /* a camera in exclusive use need not answer, so no answer means in use */
    return !ask_address(address, q, value, sizeof value) || (cap_get32(value) & 3) != 0;
}

/* Whether the camera announces a GenICam file larger than XML_MAX ("Local:name.xml;ADDRESS;SIZE").  Aravis allocates
 * the announced size before it reads the file, and GLib ends the process if there is not enough memory. */
static bool announces_nonsense(uint32_t address)
{
    for (uint32_t i = 0; i < 2; i++) {
        uint8_t what[8], got[4 + XML_URL_SIZE];
        char url[XML_URL_SIZE + 1];
        cap_put32(what, XML_URL + i * XML_URL_SIZE);
        cap_put32(what + 4, XML_URL_SIZE);
        struct question q = {.command = CAP_GVCP_READMEM, .data = what, .n = sizeof what};
        if (!ask_address(address, q, got, sizeof got))
            continue; /* Aravis gets no answer either */
        find_copy_text(url, sizeof url, got + 4);
        const char *size = strrchr(url, ';');
        if (strncasecmp(url, "local:", 6) == 0 && size != NULL &&
            strtoull(size + 1, NULL, 16) > XML_MAX)
            return true;
    }
    return false;
}

uint32_t aravis_address(const char *text)
{
    struct in_addr a;
    return inet_pton(AF_INET, text, &a) == 1 ? ntohl(a.s_addr) : 0;
}

/* ---- the route -------------------------------------------------------------------------------- */

/* The host's own address towards the camera, as the kernel routes, and the broadcast address of that network. */
static bool find_route(uint32_t camera, struct aravis_route *out)
{
    struct sockaddr_in sa = {.sin_family = AF_INET, .sin_port = htons(CAP_GVCP_PORT)};
    socklen_t len = sizeof sa;
    sa.sin_addr.s_addr = htonl(camera);
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    bool ok = fd >= 0 && connect(fd, (const struct sockaddr *)&sa, sizeof sa) == 0 &&
              getsockname(fd, (struct sockaddr *)&sa, &len) == 0;
    if (fd >= 0)
        close(fd);
    if (!ok)
        return false;
    *out = (struct aravis_route){camera, ntohl(sa.sin_addr.s_addr), camera};
    struct ifaddrs *list;
    if (getifaddrs(&list) != 0)
        return true;
    for (const struct ifaddrs *p = list; p != NULL; p = p->ifa_next) {
        struct sockaddr_in a, mask;
        if (p->ifa_addr == NULL || p->ifa_addr->sa_family != AF_INET || p->ifa_netmask == NULL)
            continue;
        memcpy(&a, p->ifa_addr, sizeof a);
        memcpy(&mask, p->ifa_netmask, sizeof mask);
        /* A broadcast does not pass a router; a camera behind one is sent its own command. */
        uint32_t m = ntohl(mask.sin_addr.s_addr);
        if (ntohl(a.sin_addr.s_addr) == out->host && m != UINT32_MAX &&
            (out->host & m) == (camera & m))
            out->broadcast = camera | ~m;
    }
    freeifaddrs(list);
    return true;
}

/* ---- names ------------------------------------------------------------------------------------ */

static pthread_mutex_t list_lock = PTHREAD_MUTEX_INITIALIZER; /* Aravis' list of devices */
static int64_t listed_mono_ns;                                /* when its last renewal began */
static pthread_mutex_t known_lock = PTHREAD_MUTEX_INITIALIZER;
static struct {
    char what[64];
    uint32_t address;
} known[REMEMBERED];
static unsigned n_known;

static uint32_t find_remembered(const char *what)
{
    uint32_t a = 0;
    pthread_mutex_lock(&known_lock);
    for (unsigned i = 0; i < REMEMBERED; i++)
        if (known[i].address != 0 && strcmp(known[i].what, what) == 0)
            a = known[i].address;
    pthread_mutex_unlock(&known_lock);
    struct aravis_who who;
    if (a != 0 && aravis_probe(a, &who) &&
        (strcmp(who.serial, what) == 0 || strcmp(who.name, what) == 0))
        return a;
    return 0;
}

static void find_remember(const char *what, uint32_t address)
{
    if (strlen(what) >= sizeof known[0].what)
        return;
    pthread_mutex_lock(&known_lock);
    unsigned at = n_known % REMEMBERED;
    for (unsigned i = 0; i < REMEMBERED; i++)
        if (strcmp(known[i].what, what) == 0)
            at = i;
    n_known += at == n_known % REMEMBERED;
    snprintf(known[at].what, sizeof known[at].what, "%s", what);
    known[at].address = address;
    pthread_mutex_unlock(&known_lock);
}

static bool is_device(unsigned i, const char *what)
{
    return g_strcmp0(arv_get_device_serial_nbr(i), what) == 0 ||
           g_strcmp0(arv_get_device_id(i), what) == 0 ||
           g_strcmp0(arv_get_device_physical_id(i), what) == 0;
}

/* The Aravis id of the first device with this serial number, id or user-defined name (NULL = none), and its address
 * if it has one. */
static char *look_up(const char *what, uint32_t *address)
{
    int64_t asked = pvx_now_mono();
    char *id = NULL;
    pthread_mutex_lock(&list_lock);
    if (listed_mono_ns < asked) { /* else another thread renewed it while we waited */
        listed_mono_ns = pvx_now_mono();
        arv_update_device_list();
    }
    for (unsigned i = 0; i < arv_get_n_devices() && id == NULL; i++) {
        struct aravis_who who;
        const char *text = arv_get_device_address(i);
        uint32_t a = text != NULL ? aravis_address(text) : 0;
        if (!is_device(i, what) &&
            !(a != 0 && aravis_probe(a, &who) && strcmp(who.name, what) == 0))
            continue;
        id = g_strdup(arv_get_device_id(i));
        *address = a;
    }
    pthread_mutex_unlock(&list_lock);
    return id;
}

static pthread_mutex_t parser_lock = PTHREAD_MUTEX_INITIALIZER;

void aravis_parser_lock(void)
{
    pthread_mutex_lock(&parser_lock);
}

void aravis_parser_unlock(void)
{
    pthread_mutex_unlock(&parser_lock);
}

void aravis_list_lock(void)
{
    pthread_mutex_lock(&list_lock);
}

void aravis_list_unlock(void)
{
    pthread_mutex_unlock(&list_lock);
}

/* ---- opening ---------------------------------------------------------------------------------- */

static ArvDevice *open_address(const struct aravis_route *r)
{
    struct in_addr camera = {htonl(r->camera)}, host = {htonl(r->host)};
    GInetAddress *to = g_inet_address_new_from_bytes((const guint8 *)&camera, G_SOCKET_FAMILY_IPV4);
    GInetAddress *from = g_inet_address_new_from_bytes((const guint8 *)&host, G_SOCKET_FAMILY_IPV4);
    ArvDevice *dev = arv_gv_device_new(from, to, NULL);
    g_object_unref(to);
    g_object_unref(from);
    return dev;
}

/* Open by route, or (id not NULL) by Aravis' id.  NULL: another program controls the camera, or (PVX_ECORRUPT) the
 * references in its GenICam file have no end. */
static ArvCamera *gev_find_open(const struct cap_source_config *c, const struct aravis_route *r,
                                const char *id, pvx_err *why, struct pvx_diag *d)
{
    aravis_parser_lock();
    ArvDevice *dev = id != NULL ? arv_open_device(id, NULL) : open_address(r);
    size_t len = 0;
    const char *xml = dev != NULL ? arv_device_get_genicam_xml(dev, &len) : NULL;
    char node[64];
    bool ends = aravis_genicam_ends(xml, len, node, sizeof node);
    if (!ends)
        *why = CAP_FAIL(c, "aravis", d, PVX_ECORRUPT,
                        "node \"%s\" of its GenICam file refers to itself, or to a "
                        "chain of more than %d nodes; restore its firmware",
                        node, ARAVIS_GENICAM_LEVELS);
    ArvCamera *cam = dev != NULL && ends ? arv_camera_new_with_device(dev, NULL) : NULL;
    aravis_parser_unlock();
    if (dev != NULL && cam == NULL)
        aravis_unref_last(dev);
    else
        g_clear_object(&dev); /* the camera holds a reference */
    return cam;
}

/* Find and open the camera.  NULL and *why: PVX_ENOENT (not there), PVX_EBUSY (another program controls it), or
 * PVX_ECORRUPT and *d (its GenICam file cannot be right).  EBUSY is found before Aravis asks for control, because for
 * a camera that does not answer Aravis would ask again for 5 s with the parser locked. */
static ArvCamera *gev_find_camera(const struct cap_source_config *c, struct aravis_route *route,
                                  pvx_err *why, struct pvx_diag *d)
{
    const char *what = c->uri;
    uint32_t address = aravis_address(what);
    char *id = NULL;
    ArvCamera *cam = NULL;
    *why = PVX_ENOENT;
    if (what[0] == '\0')
        return NULL;
    if (address != 0) {
        if (!aravis_probe(address, NULL))
            return NULL;
    } else if ((address = find_remembered(what)) == 0) {
        id = look_up(what, &address);
        if (id == NULL)
            return NULL;
    }
    if (address == 0)
        cam = gev_find_open(c, NULL, id, why, d);
    else if (aravis_controlled(address))
        *why = PVX_EBUSY;
    else if (announces_nonsense(address))
        *why = CAP_FAIL(c, "aravis", d, PVX_ECORRUPT,
                        "announces a GenICam file of more than %u MiB; restore its firmware",
                        XML_MAX >> 20);
    else if (find_route(address, route))
        cam = gev_find_open(c, route, NULL, why, d);
    if (cam != NULL && address != 0 && id != NULL)
        find_remember(what, address);
    g_free(id);
    return cam;
}

pvx_err aravis_open_camera(const struct cap_source_config *c, ArvCamera **out,
                           struct aravis_route *route, struct pvx_diag *d)
{
    aravis_log_messages();
    *route = (struct aravis_route){0};
    pvx_err why;
    ArvCamera *cam = gev_find_camera(c, route, &why, d);
    if (cam == NULL && why == PVX_ECORRUPT)
        return why;
    if (cam == NULL && why == PVX_ENOENT)
        return CAP_FAIL(c, "aravis", d, PVX_ENOENT,
                        "no camera answers there; `pyrovox cameras` lists those that do");
    ArvDevice *dev = cam != NULL ? arv_camera_get_device(cam) : NULL;
    if (cam == NULL ||
        (ARV_IS_GV_DEVICE(dev) && !arv_gv_device_is_controller(ARV_GV_DEVICE(dev)))) {
        aravis_close_camera(&cam);
        return CAP_FAIL(c, "aravis", d, PVX_EBUSY, "another program controls it");
    }
    arv_camera_set_range_check_policy(cam, ARV_RANGE_CHECK_POLICY_ENABLE);
    *out = cam;
    return PVX_OK;
}
