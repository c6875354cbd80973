/* vm_v4l2_uvc.c - the v4l2: backend on the kernel's uvcvideo: cameras by serial number, controls, a
 * cable that is pulled while frames are held.
 *   vm_v4l2_uvc FILE URI...     whoever pulls the cable of the second camera reads FILE: "running" (pull
 *                               it), "lost" (plug it again) */
#include "../t.h"
#include "../box.h"

#include "base/clock.h"
#include "base/log.h"
#include "capture/rig/capture.h"

#define PATIENCE_NS (120 * PVX_NS_PER_S) /* no wait in here should come near */
#define MAX         8

static struct cap_stats st;

/* Take sets until camera i has counted n. */
static bool until(cap_capture *cap, unsigned i, enum cap_count what, uint64_t n)
{
    int64_t end = pvx_now_mono() + PATIENCE_NS;
    do {
        struct cap_set *set;
        if (cap_capture_next(cap, 50 * PVX_NS_PER_MS, &set) == PVX_OK)
            cap_set_release(set);
        cap_capture_stats(cap, &st);
    } while (st.camera[i].count[what] < n && pvx_now_mono() < end);
    return st.camera[i].count[what] >= n;
}

static struct cap_set *a_set_with(cap_capture *cap, unsigned i)
{
    int64_t end = pvx_now_mono() + PATIENCE_NS;
    while (pvx_now_mono() < end) {
        struct cap_set *set;
        if (cap_capture_next(cap, 50 * PVX_NS_PER_MS, &set) != PVX_OK)
            continue;
        if (set->frame[i] != NULL)
            return set;
        cap_set_release(set);
    }
    return NULL;
}

static uint32_t checksum(const struct cap_image *img)
{
    uint32_t h = 2166136261u;
    for (size_t i = 0; i < img->size; i++)
        h = (h ^ ((const unsigned char *)img->data)[i]) * 16777619u;
    return h;
}

static void tell(const char *file, const char *word)
{
    FILE *f = fopen(file, "ae");
    T_OK(f != NULL);
    if (f == NULL)
        return;
    fprintf(f, "%s\n", word);
    fclose(f);
}

static char **args;
static unsigned n;

static void a_pulled_camera_comes_back_by_its_serial_number(void)
{
    static struct cap_source_config cam[MAX];
    static char name[MAX][16];
    for (unsigned i = 0; i < n; i++) {
        snprintf(name[i], sizeof name[i], "cam%u", i);
        cam[i] = (struct cap_source_config){.uri = args[1 + i],
                                            .name = name[i],
                                            .width = 160,
                                            .height = 120,
                                            .fmt = CAP_JPEG,
                                            .buffers = 8,
                                            .exposure_us = i == 1 ? 25000 : -1,
                                            .gain = i == 1 ? 33 : -1};
    }
    struct cap_capture_config cfg = {.n_cameras = n,
                                     .camera = cam,
                                     .fps = 15,
                                     .discard_first = 1,
                                     .sets = {.policy = CAP_POLICY_PARTIAL, .min_cameras = 1}};
    cap_capture *cap;
    struct pvx_diag d = {""};
    T_EQ_I(cap_capture_new(&cfg, &cap, &d), PVX_OK);
    T_EQ_I(cap_capture_start(cap, &d), PVX_OK);
    for (unsigned i = 0; i < n; i++)
        T_OK(until(cap, i, CAP_RECEIVED, 5));
    struct cap_set *held = a_set_with(cap, 1);
    T_OK(held != NULL);
    if (held == NULL)
        goto end;
    const struct cap_frame *f = held->frame[1];
    T_NEAR(f->exposure_us, 25000, 1e-9);
    T_NEAR(f->gain, 33, 0);
    T_OK(f->t_device_ns != 0); /* uvcvideo: monotonic, start of exposure */
    T_EQ_I(memcmp(f->img.data, "\xff\xd8\xff", 3), 0);
    uint32_t sum = checksum(&f->img);
    tell(args[0], "running");
    T_OK(until(cap, 1, CAP_LOST_CAMERA, 1));
    T_EQ_I(checksum(&f->img), sum); /* its memory is ours until we give it back */
    uint64_t before = st.camera[1].count[CAP_RECEIVED], other = st.camera[0].count[CAP_RECEIVED];
    T_OK(until(cap, 0, CAP_RECEIVED, other + 5)); /* the others go on */
    tell(args[0], "lost");
    T_OK(until(cap, 1, CAP_RECEIVED, before + 5));
    T_EQ_I(checksum(&f->img), sum);
    cap_set_release(held);
    T_OK(until(cap, 1, CAP_RECEIVED, before + 10));
    for (unsigned i = 0; i < n; i++) {
        if (!machine_is_busy())
            T_EQ_I(st.camera[i].count[CAP_LOST_CAMERA], i == 1);
        T_EQ_I(st.camera[i].count[CAP_BAD_SIZE] + st.camera[i].count[CAP_BAD_FORMAT], 0);
    }
end:
    cap_capture_free(&cap);
}

int main(int argc, char **argv)
{
    pvx_log_set_level(PVX_LOG_ERROR);
    args = argv + 1;
    n = argc > 3 && argc - 2 <= MAX ? (unsigned)argc - 2 : 0;
    if (n == 0)
        return 2;
    T_RUN(a_pulled_camera_comes_back_by_its_serial_number);
    return t_done();
}
