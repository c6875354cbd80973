/* device.c - devices: listed, opened, closed. */
#include "recon/opencl/device.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "base/yaml.h"
#include "recon/opencl/impl.h"

static void platform_text(const struct rec_cl_library *lib, cl_platform_id p, cl_platform_info what,
                          char *out, size_t size)
{
    char text[512] = "";
    (void)lib->GetPlatformInfo(p, what, sizeof text - 1, text, NULL);
    snprintf(out, size, "%s", text);
}

static void device_text(const struct rec_cl_library *lib, cl_device_id id, cl_device_info what,
                        char *out, size_t size)
{
    char text[512] = "";
    (void)lib->GetDeviceInfo(id, what, sizeof text - 1, text, NULL);
    const char *from = text + strspn(text, " ");
    snprintf(out, size, "%s", from);
}

/* A number of the given type; 0 where the device does not say it. */
#define DEVICE_NUMBER(lib, id, what, type, out)                             \
    do {                                                                    \
        type value_ = 0;                                                    \
        (void)(lib)->GetDeviceInfo(id, what, sizeof value_, &value_, NULL); \
        (out) = value_;                                                     \
    } while (0)

static void device_why_not(const struct rec_cl_library *lib, cl_device_id id, char out[96])
{
    char version[128];
    int major = 0, minor = 0;
    cl_bool available, compiler;
    cl_device_fp_config doubles;
    uint64_t group, local;
    DEVICE_NUMBER(lib, id, CL_DEVICE_AVAILABLE, cl_bool, available);
    DEVICE_NUMBER(lib, id, CL_DEVICE_COMPILER_AVAILABLE, cl_bool, compiler);
    DEVICE_NUMBER(lib, id, CL_DEVICE_DOUBLE_FP_CONFIG, cl_device_fp_config, doubles);
    DEVICE_NUMBER(lib, id, CL_DEVICE_MAX_WORK_GROUP_SIZE, size_t, group);
    DEVICE_NUMBER(lib, id, CL_DEVICE_LOCAL_MEM_SIZE, cl_ulong, local);
    device_text(lib, id, CL_DEVICE_VERSION, version, sizeof version);
    out[0] = '\0';
    if (!available)
        snprintf(out, 96, "it is not available");
    else if (sscanf(version, "OpenCL %d.%d", &major, &minor) != 2 || major * 10 + minor < 12)
        snprintf(out, 96, "it has %.40s, and OpenCL 1.2 is needed", version);
    else if (doubles == 0)
        snprintf(out, 96, "it has no double precision (cl_khr_fp64)");
    else if (!compiler)
        snprintf(out, 96, "its driver has no compiler");
    else if (group < REC_CL_FLAT)
        snprintf(out, 96, "its groups have at most %llu items, and %d are needed",
                 (unsigned long long)group, REC_CL_FLAT);
    else if (local < REC_CL_LOCAL_NEEDED)
        snprintf(out, 96, "its groups share %llu bytes, and %d are needed",
                 (unsigned long long)local, REC_CL_LOCAL_NEEDED);
}

static struct rec_cl_info device_info(const struct rec_cl_library *lib,
                                      const struct rec_cl_found *f)
{
    struct rec_cl_info o = {.kind = REC_CL_OTHER};
    cl_device_type type;
    cl_bool shares;
    cl_device_fp_config floats;
    device_text(lib, f->device, CL_DEVICE_NAME, o.name, sizeof o.name);
    device_text(lib, f->device, CL_DEVICE_VENDOR, o.vendor, sizeof o.vendor);
    device_text(lib, f->device, CL_DRIVER_VERSION, o.driver, sizeof o.driver);
    platform_text(lib, f->platform, CL_PLATFORM_NAME, o.platform, sizeof o.platform);
    DEVICE_NUMBER(lib, f->device, CL_DEVICE_TYPE, cl_device_type, type);
    DEVICE_NUMBER(lib, f->device, CL_DEVICE_SINGLE_FP_CONFIG, cl_device_fp_config, floats);
    DEVICE_NUMBER(lib, f->device, CL_DEVICE_HOST_UNIFIED_MEMORY, cl_bool, shares);
    o.shares = shares != CL_FALSE;
    DEVICE_NUMBER(lib, f->device, CL_DEVICE_GLOBAL_MEM_SIZE, cl_ulong, o.memory);
    DEVICE_NUMBER(lib, f->device, CL_DEVICE_MAX_MEM_ALLOC_SIZE, cl_ulong, o.largest);
    DEVICE_NUMBER(lib, f->device, CL_DEVICE_MAX_COMPUTE_UNITS, cl_uint, o.units);
    DEVICE_NUMBER(lib, f->device, CL_DEVICE_MAX_CLOCK_FREQUENCY, cl_uint, o.mhz);
    o.denormals = (floats & CL_FP_DENORM) != 0;
    if ((type & CL_DEVICE_TYPE_GPU) != 0)
        o.kind = REC_CL_GPU;
    else if ((type & CL_DEVICE_TYPE_CPU) != 0)
        o.kind = REC_CL_CPU;
    device_why_not(lib, f->device, o.why_not);
    return o;
}

/* The lower the better. */
static int device_rank(const struct rec_cl_info *o)
{
    static const char *const for_all[] = {"rusticl", "Clover", "Portable Computing Language"};
    bool any = false;
    for (size_t i = 0; i < sizeof for_all / sizeof *for_all; i++)
        any |= strcasestr(o->platform, for_all[i]) != NULL;
    return (o->kind != REC_CL_GPU) * 4 + o->shares * 2 + any;
}
static int found_later(const void *a, const void *b)
{
    const struct rec_cl_found *x = a, *y = b;
    int rank = device_rank(&x->info) - device_rank(&y->info);
    return rank != 0 ? rank : x->number < y->number ? -1 : 1;
}
void rec_cl_sort(struct rec_cl_found *f, size_t n)
{
    qsort(f, n, sizeof *f, found_later);
}

static size_t devices_find(const struct rec_cl_library *lib, struct rec_cl_found out[REC_CL_MOST])
{
    cl_platform_id platform[REC_CL_MOST];
    cl_uint platforms = 0;
    size_t n = 0;
    if (lib->GetPlatformIDs(REC_CL_MOST, platform, &platforms) != CL_SUCCESS)
        return 0;
    for (cl_uint p = 0; p < platforms && p < REC_CL_MOST; p++) {
        cl_device_id device[REC_CL_MOST];
        cl_uint devices = 0;
        if (lib->GetDeviceIDs(platform[p], CL_DEVICE_TYPE_ALL, REC_CL_MOST, device, &devices) !=
            CL_SUCCESS)
            continue;
        for (cl_uint i = 0; i < devices && i < REC_CL_MOST && n < REC_CL_MOST; i++, n++) {
            out[n] = (struct rec_cl_found){platform[p], device[i], .number = n};
            out[n].info = device_info(lib, &out[n]);
        }
    }
    rec_cl_sort(out, n);
    return n;
}

static pvx_err devices_none(struct pvx_diag *d)
{
    return pvx_fail(d, PVX_ENOENT,
                    "OpenCL knows no device: install the driver of the card, and see what clinfo "
                    "says");
}

size_t rec_cl_list(struct rec_cl_info out[REC_CL_MOST], struct pvx_diag *d)
{
    struct rec_cl_found found[REC_CL_MOST];
    const struct rec_cl_library *lib = rec_cl_library(d);
    size_t n = lib != NULL ? devices_find(lib, found) : 0;
    if (lib != NULL && n == 0)
        (void)devices_none(d);
    for (size_t i = 0; i < n; i++)
        out[i] = found[i].info;
    return n;
}

static bool device_is_meant(const struct rec_cl_info *o, const char *name)
{
    if (name[0] == '\0')
        return o->kind == REC_CL_GPU;
    return strcasestr(o->name, name) != NULL || strcasestr(o->platform, name) != NULL;
}

/* No device has the name: what there is. */
static pvx_err device_unknown(const char *name, const struct rec_cl_found *f, size_t n,
                              struct pvx_diag *d)
{
    char text[512] = "";
    size_t at = 0;
    for (size_t i = 0; i < n && at < sizeof text; i++) {
        int more = snprintf(text + at, sizeof text - at, "%s%s (%s)", i > 0 ? ", " : "",
                            f[i].info.name, f[i].info.platform);
        at += more > 0 ? (size_t)more : 0;
    }
    if (name[0] == '\0')
        return pvx_fail(d, PVX_ENOENT, "OpenCL knows no graphics card; by name there are: %s",
                        text);
    return pvx_fail(d, PVX_ENOENT, "OpenCL knows no device \"%s\"; there are: %s", name, text);
}

/* The first one that is meant and can be used. */
static pvx_err device_choose(const struct rec_cl_library *lib, const char *name,
                             struct rec_cl_found *out, struct pvx_diag *d)
{
    struct rec_cl_found found[REC_CL_MOST];
    const struct rec_cl_info *unfit = NULL;
    size_t n = devices_find(lib, found);
    if (n == 0)
        return devices_none(d);
    for (size_t i = 0; i < n; i++) {
        const struct rec_cl_info *o = &found[i].info;
        if (!device_is_meant(o, name))
            continue;
        if (o->why_not[0] == '\0') {
            *out = found[i];
            return PVX_OK;
        }
        unfit = unfit != NULL ? unfit : o;
    }
    if (unfit != NULL)
        return pvx_fail(d, PVX_EUNSUP, "%s (%s) cannot be used: %s", unfit->name, unfit->platform,
                        unfit->why_not);
    return device_unknown(name, found, n, d);
}

static pvx_err device_fill(rec_cl *cl, struct pvx_diag *d)
{
    cl_int e = CL_SUCCESS;
    cl_context_properties of[] = {CL_CONTEXT_PLATFORM, (cl_context_properties)cl->platform, 0};
    cl->context = cl->lib->CreateContext(of, 1, &cl->device, NULL, NULL, &e);
    if (cl->context == NULL || e != CL_SUCCESS)
        return pvx_fail(d, PVX_ENODEV, "%s: clCreateContext: %s", cl->info.name, rec_cl_error(e));
    cl->zeroes = cl->lib->CreateCommandQueue(cl->context, cl->device, 0, &e);
    if (cl->zeroes == NULL || e != CL_SUCCESS)
        return pvx_fail(d, PVX_ENODEV, "%s: clCreateCommandQueue: %s", cl->info.name,
                        rec_cl_error(e));
    return PVX_OK;
}

/* Tests do not wait for so long. */
static double device_patience(void)
{
    const char *text = getenv("PYROVOX_OPENCL_PATIENCE");
    double s = REC_CL_PATIENCE;
    if (text != NULL && text[0] != '\0' && pvx_parse_double(text, 0, 3600, &s) != PVX_OK)
        s = REC_CL_PATIENCE;
    return s;
}

static pvx_err device_open(const struct rec_cl_library *lib, const struct rec_cl_found *which,
                           rec_cl **out, struct pvx_diag *d)
{
    rec_cl *cl = *out = pvx_calloc(1, sizeof *cl);
    PVX_NEED(cl);
    cl->lib = lib;
    cl->platform = which->platform;
    cl->device = which->device;
    cl->info = which->info;
    cl->patience = device_patience();
    pthread_mutex_init(&cl->zeroing, NULL);
    pvx_err e = device_fill(cl, d);
    if (e != PVX_OK)
        rec_cl_close(out);
    return e;
}

pvx_err rec_cl_open(const char *name, rec_cl **out, struct pvx_diag *d)
{
    struct rec_cl_found which;
    *out = NULL;
    const struct rec_cl_library *lib = rec_cl_library(d);
    if (lib == NULL)
        return PVX_ENOENT;
    PVX_TRY(device_choose(lib, name, &which, d));
    PVX_TRY(device_open(lib, &which, out, d));
    pvx_err e = rec_cl_build(*out, d);
    if (e != PVX_OK)
        rec_cl_close(out);
    return e;
}

pvx_err rec_cl_open_bare(size_t number, rec_cl **out, struct pvx_diag *d)
{
    struct rec_cl_found found[REC_CL_MOST];
    *out = NULL;
    const struct rec_cl_library *lib = rec_cl_library(d);
    if (lib == NULL)
        return PVX_ENOENT;
    if (number >= devices_find(lib, found))
        return devices_none(d);
    return device_open(lib, &found[number], out, d);
}

static void device_release(rec_cl *cl)
{
    for (int f = 0; f < REC_CL_N_FILES; f++)
        for (int four = 0; four < 2; four++)
            if (cl->program[f][four] != NULL)
                (void)cl->lib->ReleaseProgram(cl->program[f][four]);
    if (cl->zeroes != NULL)
        (void)cl->lib->ReleaseCommandQueue(cl->zeroes);
    if (cl->context != NULL)
        (void)cl->lib->ReleaseContext(cl->context);
}

void rec_cl_close(rec_cl **cl)
{
    if (*cl == NULL)
        return;
    if (rec_cl_lost(*cl) == NULL)
        device_release(*cl);
    pthread_mutex_destroy(&(*cl)->zeroing);
    PVX_FREE(*cl);
}

const struct rec_cl_info *rec_cl_about(const rec_cl *cl)
{
    return &cl->info;
}
