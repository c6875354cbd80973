/* test_photometry.c - daemon/pipeline/photometry.h: whether pictures are those that a rig's photometry is for. */
#include "../t.h"

#include <stdbool.h>

#include "daemon/pipeline/photometry.h"

static struct rec_camera measured(void)
{
    struct rec_camera k = {.name = "cam1"};
    struct rec_photometry *p = &k.photometry;
    snprintf(p->serial, sizeof p->serial, "aravis:GV01");
    snprintf(p->dark.file, sizeof p->dark.file, "d.npy");
    p->has_exposure = p->has_gain = true;
    p->exposure = 0.001;
    p->gain_db = 6;
    return k;
}

static void is(const struct rec_camera *k, double exposure, double gain, const char *serial,
               const char *refused)
{
    const struct dmn_photometry_taken as = {exposure, gain, serial};
    struct pvx_diag d = {""};
    T_EQ_I(dmn_photometry_check(k, &as, "a.h5", &d), refused == NULL ? PVX_OK : PVX_EINVAL);
    if (refused != NULL)
        T_CONTAINS(d.text, refused);
    else
        T_EQ_S(d.text, "");
}

T_CASE(pictures_of_the_darks_kind)
{
    struct rec_camera k = measured();
    is(&k, 0.001, 6, "aravis:GV01", NULL);
    is(&k, 0.00101, 6.05, "aravis:GV01", NULL);
    is(&k, NAN, NAN, NULL, NULL);            /* a folder says nothing */
    is(&k, 0.001, 6, "take:flame.h5", NULL); /* a recording is called otherwise */
    is(&k, 0.001, 6, "aravis:GV02",
       "a.h5: camera cam1 is aravis:GV02, but the rig's photometry was");
    is(&k, 0.002, 6, "aravis:GV01", "camera cam1 exposed 2 ms, but its dark is of 1 ms");
    is(&k, 0.001, 12, "aravis:GV01", "camera cam1 had a gain of 12 dB, but its dark is of 6 dB");
    k.photometry.dark.file[0] = '\0'; /* a flat is of any exposure */
    is(&k, 0.002, 12, "aravis:GV01", NULL);
}

T_CASE(rigs_without_any_have_none)
{
    struct rec_rig rig;
    dmn_photometry *p;
    struct pvx_diag d = {""};
    T_EQ_I(rec_rig_ring(2, 2.5, 32, 24, 8, &rig), PVX_OK);
    rig.cameras[0].gain[0] = 2;
    T_EQ_I(dmn_photometry_load("rig.yaml", DMN_LIGHT_ALL, &rig, &p, &d), PVX_OK);
    T_OK(p == NULL && dmn_photometry_of(p, 0) == NULL);
    T_NEAR((double)rig.cameras[0].gain[0], 2, 0); /* the carver's, as ever */
    rig.cameras[0].photometry.n_response = 2;     /* now its pixels are given it */
    rig.cameras[0].photometry.response[1] = 1;
    T_EQ_I(dmn_photometry_load("rig.yaml", DMN_LIGHT_ALL, &rig, &p, &d), PVX_OK);
    T_NEAR((double)dmn_photometry_of(p, 0)->gain[0], 2, 0);
    T_NEAR((double)rig.cameras[0].gain[0], 1, 0);
    T_OK(dmn_photometry_of(p, 1) == NULL);
    dmn_photometry_free(&p);
    rec_rig_fini(&rig);
}
