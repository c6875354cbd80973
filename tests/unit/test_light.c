/* test_light.c - recon/light in doubles: gains, colours, the flame's middle and light, what is refused.  Darks,
 * flats and responses are judged by tests/sim/test_cli_light.c. */
#include "../t.h"

#include "recon/light/light.h"

T_CASE(gains_have_the_product_1)
{
    const double light[] = {0.2, 0.4, 0, 0.8};
    double gain[4];
    rec_light_gains(light, 4, gain);
    T_NEAR(gain[0], 2, 1e-12);
    T_NEAR(gain[1], 1, 1e-12);
    T_NEAR(gain[2], 1, 0); /* it saw nothing */
    T_NEAR(gain[3], 0.5, 1e-12);
}

static void mix(const double M[9], const double v[3], double out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] = M[3 * r] * v[0] + M[3 * r + 1] * v[1] + M[3 * r + 2] * v[2];
}

T_CASE(colours_to_those_of_another_camera)
{
    static const double M[9] = {0.9, 0.15, -0.05, 0.1, 1.05, 0.02, -0.03, 0.2, 0.8};
    double from[15], to[15], got[9], residual;
    struct pvx_diag d = {""};
    for (int k = 0; k < 5; k++) {
        for (int a = 0; a < 3; a++)
            from[3 * k + a] = t_uniform(0.05, 0.2) + (k % 3 == a ? 0.5 : 0);
        mix(M, from + 3 * k, to + 3 * k);
    }
    T_EQ_I(rec_light_matrix(from, to, 5, got, &residual, &d), PVX_OK);
    T_NEAR(residual, 0, 1e-12);
    for (int i = 0; i < 9; i++)
        T_NEAR(got[i], M[i], 1e-9);
    T_EQ_I(rec_light_matrix(from, to, 2, got, &residual, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "at least three");
    d.text[0] = '\0';
    for (int k = 0; k < 15; k++) /* greys */
        from[k] = 0.3 + 0.1 * (k / 3) + 1e-4 * (k % 3);
    T_EQ_I(rec_light_matrix(from, to, 5, got, &residual, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "too alike");
}

enum { W = 60, H = 40 };

/* A small square of light about the picture of X. */
static void spot(const struct rec_camera *c, const double X[3], float *px)
{
    double uv[2];
    T_OK(rec_camera_project(c, X, uv));
    for (int i = 0; i < W * H; i++)
        px[i] = fabs(i % W - uv[0]) < 2 && fabs(i / W - uv[1]) < 2 ? 0.5f : 0;
}

T_CASE(where_a_flame_is)
{
    struct rec_rig rig;
    static float px[4][W * H];
    struct rec_light_picture p[4];
    const struct rec_light_picture *of[4];
    struct pvx_diag d = {""};
    const double X[3] = {0.1, -0.05, 0.45};
    double at[3];
    T_EQ_I(rec_rig_ring(4, 2.5, W, H, 8, &rig), PVX_OK);
    for (size_t c = 0; c < 4; c++) {
        spot(&rig.cameras[c], X, px[c]);
        p[c] = (struct rec_light_picture){
            .width = W, .height = H, .channels = 1, .n = 1, .mean = px[c], .var = px[c]};
        of[c] = &p[c];
    }
    T_EQ_I(rec_light_where(of, rig.cameras, 4, at, &d), PVX_OK);
    for (int a = 0; a < 3; a++)
        T_NEAR(at[a], X[a], 0.02); /* a pixel is 0.03 m there */
    T_EQ_I(rec_light_where(of, rig.cameras, 1, at, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "from one side only");
    double flux[3];
    d.text[0] = '\0';
    px[0][0] = 1; /* light at the border */
    T_EQ_I(rec_light_flux(&p[0], &rig.cameras[0], X, flux, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "at the picture's border");
    d.text[0] = '\0';
    memset(px[0], 0, sizeof px[0]);
    T_EQ_I(rec_light_flux(&p[0], &rig.cameras[0], X, flux, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "no flame");
    rec_rig_fini(&rig);
}
