/* test_sequence.c - which files a name stands for, and their numbers. */
#include "../t.h"

#include "capture/files/sequence.h"
#include "tests/lib/scratch.h"

static void touch(const char *name)
{
    FILE *f = fopen(at("%s", name), "w");
    T_OK(f != NULL);
    if (f != NULL)
        fclose(f);
}

static pvx_err find(const char *what, struct cap_sequence *s, struct pvx_diag *d)
{
    char name[256];
    snprintf(name, sizeof name, "%s%s", dir, what);
    d->text[0] = '\0';
    return cap_sequence_find(name, s, d);
}

static void numbers(const char *what, const char *expected)
{
    struct cap_sequence s;
    struct pvx_diag d;
    pvx_err e = find(what, &s, &d);
    char got[256] = "";
    for (size_t i = 0; i < s.n; i++) {
        size_t n = strlen(got);
        snprintf(got + n, sizeof got - n, "%s%lld", i > 0 ? " " : "", (long long)s.item[i].number);
        T_EQ_I(access(s.item[i].path, R_OK), 0);
    }
    T_CHECK_(e == PVX_OK, "%s: %s", what, d.text);
    T_EQ_S(got, expected);
    cap_sequence_free(&s);
    T_OK(s.n == 0 && s.item == NULL);
}

static void fails(const char *what, pvx_err want, const char *part)
{
    struct cap_sequence s;
    struct pvx_diag d;
    T_EQ_I(find(what, &s, &d), want);
    T_CONTAINS(d.text, part);
    cap_sequence_free(&s);
}

T_CASE(files_are_found_and_sorted)
{
    scratch_new();
    touch("000010.png");
    touch("000002.png");
    touch("000009.png");
    touch("1000000.png"); /* wider than the pattern, as printf would write it */
    touch("0000011.png"); /* printf would not */
    touch("12.png");
    touch("notes.txt");
    touch("x3y.npy");
    numbers("/%06d.png", "2 9 10 1000000");
    numbers("/%d.png", "12 1000000");
    numbers("/x%dy.npy", "3");
    numbers("/0000*.png", "2 9 10 11");
    numbers("/12.png", "12");
    scratch_remove();
}

T_CASE(folder_takes_images_only)
{
    scratch_new();
    touch("img7.TIF");
    touch("img_3_005.jpeg");
    touch("6.npy");
    touch("4.txt");
    touch("flame.png"); /* no number: not part of a sequence */
    numbers("", "5 6 7");
    numbers("/", "5 6 7");
    numbers("/flame.png", "0"); /* but an image by itself */
    scratch_remove();
}

/* What may be a picture of another type is named; what cannot be one is not. */
T_CASE(other_types_are_counted)
{
    static const char *const quiet[] = {"Thumbs.db", "000003.txt", "1.JSON",  "x2.xml",   "README",
                                        ".DS_Store", "2.mov",      "run.log", "_run.cihx"};
    static const char *const named[] = {"000003.ppm", "4.BMP",      "5.webp", "cam.cxd",
                                        "000007",     "8.tif.part", "9.raw"};
    struct cap_sequence s;
    struct pvx_diag d;
    scratch_new();
    touch("1.png");
    T_EQ_I(mkdir(at("dark.1"), 0700), 0);
    for (size_t i = 0; i < sizeof quiet / sizeof quiet[0]; i++)
        touch(quiet[i]);
    T_EQ_I(find("", &s, &d), PVX_OK);
    T_OK(s.n == 1 && s.unknown == 0 && s.first_unknown == NULL);
    cap_sequence_free(&s);
    for (size_t i = 0; i < sizeof named / sizeof named[0]; i++) {
        touch(named[i]);
        T_EQ_I(find("", &s, &d), PVX_OK);
        T_OK(s.n == 1 && s.unknown == 1);
        T_CONTAINS(s.first_unknown, named[i]);
        cap_sequence_free(&s);
        T_EQ_I(find("/*", &s, &d), PVX_OK);
        T_EQ_I(s.unknown, 1);
        cap_sequence_free(&s);
        T_EQ_I(unlink(at("%s", named[i])), 0);
    }
    T_EQ_I(unlink(at("1.png")), 0);
    touch("000003.ppm");
    fails("", PVX_ENOENT, "save as one of these types: 000003.ppm");
    scratch_remove();
}

/* Microseconds, dates, and nanoseconds; hidden files beside them. */
T_CASE(numbers_have_64_bits)
{
    scratch_new();
    touch("4294967295.png");
    touch("4294967300.PNG");
    touch("x202311021200.jpeg");
    touch("00000000001700000000123456789.JPG");
    touch("._4294967300.png");
    numbers("", "4294967295 4294967300 202311021200 1700000000123456789");
    touch("20231102120000123456.png");
    fails("", PVX_ERANGE, "/20231102120000123456.png: its number is beyond 9223372036854775807");
    scratch_remove();
    scratch_new();
    touch("._5.png");
    fails("", PVX_ENOENT, "no numbered image");
    fails("/.*.png", PVX_ENOENT, "no numbered image");
    touch("flame.png");
    fails("", PVX_ENOENT, "no number in the name of flame.png");
    scratch_remove();
}

/* The last digits count within the others, or start again. */
T_CASE(other_digits_do_not_contradict)
{
    scratch_new();
    touch("120000950_8.png");
    touch("120001050_9.png");
    touch("120001150_10.png");
    numbers("", "8 9 10");
    scratch_remove();
    scratch_new();
    struct cap_sequence s;
    struct pvx_diag d;
    touch("000000.png");
    touch("000001.TIF");
    T_EQ_I(find("", &s, &d), PVX_OK);
    T_EQ_I(s.odd, 0);
    cap_sequence_free(&s);
    touch("dark_7.png"); /* taken, and said */
    T_EQ_I(find("", &s, &d), PVX_OK);
    T_EQ_I(s.odd, 2);
    cap_sequence_free(&s);
    scratch_remove();
    scratch_new();
    touch("12-00-00.950.png");
    touch("12-00-01.050.png");
    fails("", PVX_EINVAL, "their names end in a time of day");
    touch("a12-00-00.png"); /* no time */
    numbers("/a*.png", "0");
    scratch_remove();
    scratch_new();
    touch("cam0_12-00-05-250.png"); /* in order, by chance */
    touch("cam0_12-00-06-300.png");
    fails("", PVX_EINVAL, "as 43206300, and say --numbers ms");
    scratch_remove();
    scratch_new();
    touch("2023-11-02 23h59m58s9.png");
    touch("2023-11-02 23h59m59s10.png");
    fails("", PVX_EINVAL, "time of day");
    scratch_remove();
    scratch_new();
    touch("exp01_02_03_0004.png"); /* one second, or none */
    touch("exp01_02_03_0005.png");
    numbers("", "4 5");
    scratch_remove();
    scratch_new();
    touch("112-00-05-250.png");
    touch("112-00-06-300.png");
    touch("112-61-06-301.png");
    numbers("", "250 300 301");
    scratch_remove();
    scratch_new();
    touch("1-2-9.png");
    touch("1-3-8.png");
    fails("", PVX_EINVAL, "8.png and");
    T_EQ_I(unlink(at("1-3-8.png")), 0);
    scratch_remove();
}

T_CASE(bad_names_are_explained)
{
    scratch_new();
    fails("", PVX_ENOENT, "no numbered image");
    touch("5.png");
    touch("a05.png");
    fails("", PVX_EINVAL, "5.png have the same frame number");
    T_EQ_I(unlink(at("a05.png")), 0);
    touch("000005.TIF");
    fails("", PVX_EINVAL, "same frame number");
    fails("/nosuch", PVX_ENOENT, "no such file");
    fails("/nosuch/%06d.png", PVX_ENOENT, "No such file");
    fails("/b%06d.png", PVX_ENOENT, "no numbered image");
    fails("/b*.png", PVX_ENOENT, "no numbered image");
    fails("/%s.png", PVX_EINVAL, "%d");
    fails("/%06d_%d.png", PVX_EINVAL, "%d");
    fails("/%.png", PVX_EINVAL, "%d");
    fails("/%099d.png", PVX_EINVAL, "digits");
    struct cap_sequence s;
    T_EQ_I(cap_sequence_find("", &s, NULL), PVX_EINVAL);
    cap_sequence_free(&s);
    scratch_remove();
}
