/* test_photometry.c - daemon/pipeline/photometry.h: whether pictures are those that a rig's photometry is for. */
#include "../t.h"

#include <limits.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

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

static void taken(const struct rec_camera *k, struct dmn_photometry_taken as, const char *refused)
{
    struct pvx_diag d = {""};
    T_EQ_I(dmn_photometry_check(k, &as, "a.h5", &d), refused == NULL ? PVX_OK : PVX_EINVAL);
    if (refused != NULL)
        T_CONTAINS(d.text, refused);
    else
        T_EQ_S(d.text, "");
}

static void is(const struct rec_camera *k, double exposure, double gain, const char *serial,
               const char *refused)
{
    taken(k, (struct dmn_photometry_taken){exposure, gain, NAN, serial, NULL}, refused);
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

T_CASE(serial_numbers_count_for_more_than_names)
{
    struct rec_camera k = measured();
    struct dmn_photometry_taken as = {0.001, 6, NAN, "aravis:10.0.0.7", "S7"};
    taken(&k, as, "cam1 is aravis:10.0.0.7, but the rig's photometry was measured on aravis:GV01");
    snprintf(k.photometry.device, sizeof k.photometry.device, "S7");
    taken(&k, as, NULL); /* the same, by another name */
    as.serial = "aravis:GV01";
    as.device = "S8";
    taken(&k, as, "cam1 is S8, but the rig's photometry was measured on S7");
    as.device = ""; /* an old take */
    taken(&k, as, NULL);
    as.serial = "aravis:GV02";
    taken(&k, as, "cam1 is aravis:GV02");
}

T_CASE(darks_of_another_temperature)
{
    struct rec_camera k = measured();
    struct dmn_photometry_taken as = {0.001, 6, 48.1, "aravis:GV01", ""};
    taken(&k, as, NULL); /* the darks do not say theirs */
    k.photometry.has_temperature = true;
    k.photometry.temperature = 43;
    taken(&k, as, "cam1 had 48.1 degrees Celsius, but its dark is of 43.0");
    as.temperature_c = 47.9;
    taken(&k, as, NULL);
    as.temperature_c = 37.9;
    taken(&k, as, "37.9 degrees");
    as.temperature_c = NAN;
    taken(&k, as, NULL);
    as.temperature_c = 10;
    k.photometry.dark.file[0] = '\0'; /* a flat is of any temperature */
    taken(&k, as, NULL);
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
    rig.cameras[0].photometry.read_noise = 0.003;
    rig.cameras[0].photometry.noise_gain = 3e-4;
    T_EQ_I(dmn_photometry_load("rig.yaml", DMN_LIGHT_ALL, &rig, &p, &d), PVX_OK);
    T_NEAR((double)dmn_photometry_of(p, 0)->gain[0], 2, 0);
    T_NEAR((double)rig.cameras[0].gain[0], 1, 0);
    T_NEAR(rig.cameras[0].photometry.read_noise, 0.006, 1e-9); /* behind gains of 2, 1, 1 */
    T_NEAR(rig.cameras[0].photometry.noise_gain, 4e-4, 1e-9);
    T_OK(dmn_photometry_of(p, 1) == NULL);
    dmn_photometry_free(&p);
    rec_rig_fini(&rig);
}

static void moved(const char *from, const char *to, const char *file, const char *want)
{
    struct rec_rig rig;
    struct pvx_diag d = {""};
    T_EQ_I(rec_rig_ring(2, 2.5, 32, 24, 8, &rig), PVX_OK);
    struct rec_map *m = &rig.cameras[1].photometry.flat;
    snprintf(m->file, sizeof m->file, "%s", file);
    pvx_err e = dmn_photometry_move(&rig, from, to, &d);
    T_EQ_I(e, want != NULL ? PVX_OK : PVX_ERANGE);
    T_EQ_S(m->file, want != NULL ? want : file);
    T_EQ_S(rig.cameras[0].photometry.flat.file, "");
    if (want == NULL)
        T_CONTAINS(d.text, "write the rig beside");
    rec_rig_fini(&rig);
}

T_CASE(maps_of_a_rig_that_is_written_elsewhere)
{
    char at[] = "/tmp/pvx-move-XXXXXX", here[PATH_MAX], want[PATH_MAX + 8],
         longest[REC_MAP_FILE_MAX];
    T_OK(mkdtemp(at) != NULL && realpath(at, here) != NULL && chdir(at) == 0);
    T_OK(mkdir("a", 0700) == 0 && mkdir("a/b", 0700) == 0 && mkdir("ab", 0700) == 0);
    moved("rig.yaml", "new.yaml", "f.npy", "f.npy");
    moved("a/rig.yaml", "./a/new.yaml", "f.npy", "f.npy");
    moved("rig.yaml", "a/new.yaml", "f.npy", "../f.npy");
    moved("a/b/rig.yaml", "new.yaml", "m/f.npy", "a/b/m/f.npy");
    moved("a/b/rig.yaml", "ab/new.yaml", "f.npy", "../a/b/f.npy");
    moved("rig.yaml", "a/new.yaml", "/x/f.npy", "/x/f.npy");
    snprintf(want, sizeof want, "%s/f.npy", here);
    moved("rig.yaml", NULL, "f.npy", want);
    memset(longest, 'x', sizeof longest - 1);
    longest[sizeof longest - 1] = '\0';
    moved("rig.yaml", "new.yaml", longest, longest);
    moved("rig.yaml", "a/new.yaml", longest, NULL);
    rmdir("a/b");
    rmdir("a");
    rmdir("ab");
    T_OK(chdir("/") == 0 && rmdir(at) == 0);
}
