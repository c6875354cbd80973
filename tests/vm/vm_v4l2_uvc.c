/* vm_v4l2_uvc.c - the v4l2: backend on the kernel's uvcvideo: cameras by serial number, controls, a
 * cable that is pulled while frames are held.
 *   vm_v4l2_uvc FILE URI...     whoever pulls the cable of the second camera reads FILE: "running" (pull
 *                               it), "lost" (plug it again) */
#include "tests/lib/box.h"
#include "tests/lib/rig.h"

static struct rig r;

static struct cap_set *a_set_with(unsigned i)
{
    UNTIL (false) {
        struct cap_set *set;
        if (cap_capture_next(r.cap, 50 * PVX_NS_PER_MS, &set) != PVX_OK)
            continue;
        if (set->frame[i] != NULL)
            return set;
        cap_set_release(set);
    }
    return NULL;
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

T_CASE(a_pulled_camera_comes_back_by_its_serial_number)
{
    rig_init(&r, n, 15, source_of(NULL, 160, 120, CAP_JPEG, 0));
    for (unsigned i = 0; i < n; i++)
        r.cam[i].uri = args[1 + i];
    r.cam[1].exposure_us = 25000;
    r.cam[1].gain = 33;
    r.cfg.discard_first = 1;
    rig_start(&r);
    for (unsigned i = 0; i < n; i++)
        T_OK(rig_counts(&r, i, CAP_RECEIVED, 5));
    struct cap_set *held = a_set_with(1);
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
    T_OK(rig_counts(&r, 1, CAP_LOST_CAMERA, 1));
    T_EQ_I(checksum(&f->img), sum); /* its memory is ours until we give it back */
    uint64_t before = r.st.camera[1].count[CAP_RECEIVED],
             other = r.st.camera[0].count[CAP_RECEIVED];
    T_OK(rig_counts(&r, 0, CAP_RECEIVED, other + 5)); /* the others go on */
    tell(args[0], "lost");
    T_OK(rig_counts(&r, 1, CAP_RECEIVED, before + 5));
    T_EQ_I(checksum(&f->img), sum);
    cap_set_release(held);
    T_OK(rig_counts(&r, 1, CAP_RECEIVED, before + 10));
    for (unsigned i = 0; i < n; i++) {
        if (!machine_is_busy())
            T_EQ_I(r.st.camera[i].count[CAP_LOST_CAMERA], i == 1);
        T_EQ_I(r.st.camera[i].count[CAP_BAD_SIZE] + r.st.camera[i].count[CAP_BAD_FORMAT], 0);
    }
end:
    rig_end(&r);
}

int main(int argc, char **argv)
{
    pvx_log_set_level(PVX_LOG_ERROR);
    args = argv + 1;
    n = argc > 3 && argc - 2 <= RIG_MAX ? (unsigned)argc - 2 : 0;
    if (n == 0)
        return 2;
    return t_run();
}
