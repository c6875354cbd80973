/* Parts of the simulated cameras and of the aravis: source that need no network. */
#include <unistd.h>

#include "capture/gev/ids.h"
#include "capture/gevsim/netns.h"
#include "capture/gevsim/gvcam.h"
#include "tests/lib/have_addresses.h"
#include "tests/t.h"

T_CASE(ids_widen_past_the_wrap)
{
    struct aravis_ids s = {0};
    T_EQ_I(aravis_ids_next(&s, 65533), 65533);
    T_EQ_I(aravis_ids_next(&s, 65535), 65535);
    T_EQ_I(aravis_ids_next(&s, 1), 65536); /* 0 is never sent */
    T_EQ_I(aravis_ids_next(&s, 4), 65539);
    for (uint32_t k = 5; k <= 65535; k++)
        aravis_ids_next(&s, k);
    T_EQ_I(aravis_ids_next(&s, 2), 65539 + 65531 + 2);
}

T_CASE(ids_gap_over_the_wrap)
{
    struct aravis_ids s = {0};
    aravis_ids_next(&s, 65530);
    T_EQ_I(aravis_ids_next(&s, 10), 65530 + 15); /* 65531..65535 and 1..10 */
}

T_CASE(ids_of_64_bit)
{
    struct aravis_ids s = {0};
    T_EQ_I(aravis_ids_next(&s, 0), 0); /* USB3 Vision begins with 0 */
    T_EQ_I(aravis_ids_next(&s, 1), 1);
    T_EQ_I(aravis_ids_next(&s, 30000), 30000);
    for (uint64_t k = 30001; k <= 65540; k++)
        aravis_ids_next(&s, k);
    T_EQ_I(s.id, 65540);
    T_EQ_I(aravis_ids_next(&s, 70000), 70000);
}

T_CASE(ids_that_start_anew)
{
    struct aravis_ids s = {0};
    aravis_ids_next(&s, 500);
    T_EQ_I(aravis_ids_next(&s, 499), 501); /* backwards is not a gap of 65534 */
    T_EQ_I(aravis_ids_next(&s, 500), 502);
    T_EQ_I(aravis_ids_next(&s, 500), 503); /* the same again */
    s = (struct aravis_ids){0};
    aravis_ids_next(&s, 100000);
    T_EQ_I(aravis_ids_next(&s, 1), 100001);
    T_EQ_I(aravis_ids_next(&s, 2), 100002);
}

T_CASE(stamp_names_its_image)
{
    static const double rates[] = {15, 24, 25, 29.97, 30, 60};
    for (size_t r = 0; r < sizeof rates / sizeof rates[0]; r++)
        for (int k = 0; k < 200; k++) {
            int64_t i = (int64_t)(1.79e9 * rates[r]) + (int64_t)(t_rand() % 1000000);
            int64_t t = (int64_t)llroundl((long double)i * 1e9L / (long double)rates[r]);
            double period = 1e9 / rates[r];
            T_EQ_I(cap_gvcam_index(t, rates[r]), i);
            T_EQ_I(cap_gvcam_index(t - (int64_t)(0.24 * period), rates[r]), i);
            T_EQ_I(cap_gvcam_index(t + (int64_t)(0.74 * period), rates[r]), i);
        }
}

T_CASE(addresses_in_a_row)
{
    char text[16];
    T_EQ_I(cap_netns_address("127.0.0.2", 7, text), PVX_OK);
    T_EQ_S(text, "127.0.0.9");
    T_EQ_I(cap_netns_address("127.0.0.2", 252, text), PVX_OK);
    T_EQ_S(text, "127.0.0.254");
    T_EQ_I(cap_netns_address("127.0.0.2", 253, text), PVX_EINVAL);
    T_EQ_I(cap_netns_address("localhost", 0, text), PVX_EINVAL);
    T_EQ_I(cap_netns_address("127.0.0", 0, text), PVX_EINVAL);
    T_OK(!have_addresses("203.0.113.7", 1));
    T_OK(!have_addresses("nonsense", 1));
}

T_CASE(namespace_is_private_and_works)
{
    char before[64] = "", after[64] = "";
    T_OK(!have_addresses("127.0.0.77", 1));
    T_OK(readlink("/proc/self/ns/net", before, sizeof before - 1) > 0);
    unsigned uid = getuid(), gid = getgid();
    struct pvx_diag d = {""};
    T_EQ_I(cap_netns_enter(0, &d), PVX_EINVAL);
    d.text[0] = '\0';
    pvx_err e = cap_netns_enter(100, &d);
    if (e == PVX_EPERM || e == PVX_EUNSUP) {
        T_CONTAINS(d.text, "private network");
        T_SKIP("namespaces are not allowed here");
    }
    T_EQ_I(e, PVX_OK);
    T_OK(readlink("/proc/self/ns/net", after, sizeof after - 1) > 0);
    T_OK(strcmp(before, after) != 0);
    T_OK(have_addresses("127.0.0.2", 100));
    T_OK(!have_addresses("127.0.0.2", 101));
    T_EQ_I(getuid(), uid);
    T_EQ_I(getgid(), gid);
}

static const unsigned char pixel[3];
static const void *const ring[1] = {pixel};
static const struct cap_gvcam_config good = {.address = "127.0.0.2",
                                             .serial = "S",
                                             .fmt = CAP_RGB8,
                                             .width = 1,
                                             .height = 1,
                                             .ring = ring,
                                             .n_ring = 1,
                                             .ring_fps = 10};

T_CASE(refused_configurations)
{
    cap_gvnet *net;
    cap_gvcam *s;
    struct cap_gvcam_config c = good;
    struct pvx_diag d = {""};
    T_EQ_I(cap_gvnet_new(&net, &d), PVX_OK);
    c.fmt = CAP_GREY_F32;
    T_EQ_I(cap_gvcam_new(net, &c, &s, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "127.0.0.2");
    c = good;
    c.serial = "sixteen letters!";
    T_EQ_I(cap_gvcam_new(net, &c, &s, NULL), PVX_EINVAL);
    c = good;
    c.ring_fps = 0;
    T_EQ_I(cap_gvcam_new(net, &c, &s, NULL), PVX_EINVAL);
    c = good;
    c.address = "203.0.113.7";
    d.text[0] = '\0';
    T_EQ_I(cap_gvcam_new(net, &c, &s, &d), PVX_ENOENT);
    T_CONTAINS(d.text, "--private-net");
    T_OK(s == NULL);
    cap_gvnet_free(&net);
}

T_CASE(one_camera_per_address)
{
    if (!have_addresses("127.0.0.2", 1))
        T_SKIP("no address 127.0.0.2 here");
    cap_gvnet *net;
    cap_gvcam *first = NULL, *second = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(cap_gvnet_new(&net, &d), PVX_OK);
    T_EQ_I(cap_gvcam_new(net, &good, &first, &d), PVX_OK);
    T_EQ_I(cap_gvcam_new(net, &good, &second, &d), PVX_EBUSY);
    T_CONTAINS(d.text, "127.0.0.2");
    cap_gvcam_free(&first);
    T_EQ_I(cap_gvcam_new(net, &good, &second, NULL), PVX_OK); /* free again at once */
    cap_gvcam_free(&second);
    T_OK(second == NULL);
    cap_gvnet_free(&net);
}
