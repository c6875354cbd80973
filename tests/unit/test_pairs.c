/* test_pairs.c - which frames of several cameras go together, by numbers and by times. */
#include "../t.h"

#include "capture/files/pairs.h"

enum { CAMERAS = 3, MOST = 64 };

static struct cap_reel_frame frame[CAMERAS][MOST];
static char file[] = "FILE", *path[1] = {file};
static struct cap_reel reel[CAMERAS];
static const char *const name[CAMERAS] = {"cam0", "cam1", "cam2"};
static struct cap_pairs p;
static struct pvx_diag d;

/* Camera c has n frames from `at` on, each `step` after the one before. */
static void has(int c, enum cap_reel_kind kind, size_t n, int64_t at, int64_t step)
{
    reel[c] = (struct cap_reel){.kind = kind, .n = n, .frame = frame[c], .files = 1, .path = path};
    for (size_t i = 0; i < n; i++)
        frame[c][i] = (struct cap_reel_frame){.at = at + (int64_t)i * step};
}

static void lose(int c, size_t i)
{
    reel[c].n--;
    memmove(&frame[c][i], &frame[c][i + 1], (reel[c].n - i) * sizeof **frame);
}

static pvx_err pair(int cameras, enum cap_numbers numbers)
{
    d.text[0] = '\0';
    return cap_pairs_find(reel, name, (size_t)cameras, numbers, false, &p, &d);
}

/* The sets as text: the place of each camera's frame, or "-". */
static void sets(int cameras, enum cap_numbers numbers, const char *want)
{
    char got[1000] = "";
    T_EQ_I(pair(cameras, numbers), PVX_OK);
    T_EQ_S(d.text, "");
    for (size_t k = 0; k < p.n; k++)
        for (int c = 0; c < cameras; c++) {
            int64_t row = p.row[k * (size_t)cameras + (size_t)c];
            const char *before = c > 0 ? ":" : k > 0 ? " " : "";
            size_t at = strlen(got);
            if (row < 0)
                snprintf(got + at, sizeof got - at, "%s-", before);
            else
                snprintf(got + at, sizeof got - at, "%s%lld", before, (long long)row);
        }
    T_EQ_S(got, want);
}

static void fails(int cameras, enum cap_numbers numbers, const char *part)
{
    T_OK(pair(cameras, numbers) != PVX_OK);
    T_CONTAINS(d.text, part);
    cap_pairs_free(&p);
}

#define SAYS(part) T_CONTAINS(p.said != NULL ? p.said : "", part)

T_CASE(numbers_meet_their_equals)
{
    has(0, CAP_REEL_PICTURES, 4, 4294967290, 10);
    has(1, CAP_REEL_PICTURES, 4, 4294967290, 10);
    lose(1, 1);
    sets(2, CAP_NUMBERS_COUNT, "0:0 1:- 2:1 3:2");
    T_EQ_I(p.number[3], 4294967320);
    T_OK(p.t_ns == NULL && p.said == NULL);
    cap_pairs_free(&p);
    has(1, CAP_REEL_PICTURES, 20, 4294967290, 1); /* ten times the rate */
    T_EQ_I(pair(2, CAP_NUMBERS_COUNT), PVX_OK);
    T_EQ_I(p.n, 22);
    cap_pairs_free(&p);
}

/* Programs count from 0 or from 1: frames of one number are then not of one instant. */
T_CASE(counts_from_zero_and_one)
{
    has(0, CAP_REEL_PICTURES, 20, 0, 1);
    has(1, CAP_REEL_PICTURES, 20, 1, 1);
    T_EQ_I(pair(2, CAP_NUMBERS_COUNT), PVX_OK);
    SAYS("cam0 counts 20 pictures from 0, cam1 as many from 1");
    cap_pairs_free(&p);
    lose(1, 19); /* the first frame was lost */
    T_EQ_I(pair(2, CAP_NUMBERS_COUNT), PVX_OK);
    T_OK(p.said == NULL);
    cap_pairs_free(&p);
    has(0, CAP_REEL_PICTURES, 20, 1, 1);
    has(1, CAP_REEL_PICTURES, 20, 1, 1);
    T_EQ_I(pair(2, CAP_NUMBERS_COUNT), PVX_OK);
    T_OK(p.said == NULL);
    cap_pairs_free(&p);
}

T_CASE(no_number_in_common_names_the_option)
{
    has(0, CAP_REEL_PICTURES, 20, 1000000, 50000);
    has(1, CAP_REEL_PICTURES, 20, 1000003, 50000);
    has(2, CAP_REEL_PICTURES, 0, 0, 1); /* not there: nothing to compare */
    fails(3, CAP_NUMBERS_COUNT, "cam0: 0 of its 20 frames have a number that another camera has");
    T_CONTAINS(d.text, "--numbers ms, us or ns");
    sets(3, CAP_NUMBERS_US,
         "0:0:- 1:1:- 2:2:- 3:3:- 4:4:- 5:5:- 6:6:- 7:7:- 8:8:- 9:9:- 10:10:- 11:11:- 12:12:- "
         "13:13:- 14:14:- 15:15:- 16:16:- 17:17:- 18:18:- 19:19:-");
    T_EQ_I(p.t_ns[1], 1050000000);
    T_EQ_I(p.number[1], 1);
    cap_pairs_free(&p);
    has(1, CAP_REEL_PICTURES, 20, 1000000 + 15 * 50000, 50000 - 16000); /* few by chance */
    T_EQ_I(pair(2, CAP_NUMBERS_COUNT), PVX_EINVAL);
    cap_pairs_free(&p);
    has(1, CAP_REEL_PICTURES, 20, 1600000, 50000);
    T_EQ_I(pair(2, CAP_NUMBERS_COUNT), PVX_OK);
    SAYS("cam0: only 8 of its 20 frames");
    cap_pairs_free(&p);
    has(1, CAP_REEL_PICTURES, 20, 9000000, 50000); /* a clock with another zero */
    fails(2, CAP_NUMBERS_US, "their clocks must have one zero; if one trigger");
    has(1, CAP_REEL_PICTURES, 2, INT64_MAX - 5, 1);
    fails(2, CAP_NUMBERS_MS, "too large for a time");
}

T_CASE(a_first_camera_without_pictures)
{
    reel[0] = (struct cap_reel){0};
    has(1, CAP_REEL_PICTURES, 2, 1, 1);
    has(2, CAP_REEL_PICTURES, 2, 7, 1);
    fails(3, CAP_NUMBERS_COUNT, "cam1: 0 of its 2 frames");
    T_CONTAINS(d.text, "those of cam2 from 7 to 8");
}

T_CASE(the_largest_number)
{
    has(0, CAP_REEL_PICTURES, 2, INT64_MAX - 1, 1);
    has(1, CAP_REEL_PICTURES, 2, INT64_MAX - 1, 1);
    sets(2, CAP_NUMBERS_COUNT, "0:0 1:1");
    cap_pairs_free(&p);
}

/* Films with dropped frames, a late start, jitter, another rate. */
T_CASE(times_meet_the_nearest)
{
    has(0, CAP_REEL_FILM, 6, 0, 50000000);
    has(1, CAP_REEL_FILM, 6, 0, 50000000);
    lose(1, 2);
    sets(2, CAP_NUMBERS_COUNT, "0:0 1:1 2:- 3:2 4:3 5:4");
    SAYS("cam1 has no frame in 1 of 6 sets");
    cap_pairs_free(&p);
    lose(0, 4); /* neither has all */
    sets(2, CAP_NUMBERS_COUNT, "0:0 1:1 2:- 3:2 -:3 4:4");
    T_EQ_I(p.t_ns[4], 200000000);
    cap_pairs_free(&p);

    has(0, CAP_REEL_FILM, 4, 150000000, 50000000); /* the fastest begins late, and ends early */
    has(1, CAP_REEL_FILM, 9, 9000000, 50000000);
    has(2, CAP_REEL_FILM, 9, -12000000, 50000000);
    for (int i = 0; i < 9; i++)
        frame[2][i].at += i % 3 * 10000000;
    sets(3, CAP_NUMBERS_COUNT, "-:0:0 -:1:1 -:2:2 0:3:3 1:4:4 2:5:5 3:6:6 -:7:7 -:8:8");
    cap_pairs_free(&p);

    has(0, CAP_REEL_FILM, 3, 0, 100000000); /* 10 and 20 a second */
    has(1, CAP_REEL_FILM, 6, 2000000, 50000000);
    sets(2, CAP_NUMBERS_COUNT, "0:0 -:1 1:2 -:3 2:4 -:5");
    SAYS("cam1 has 20 frames a second and cam0 10");
    cap_pairs_free(&p);

    has(0, CAP_REEL_FILM, 5, 0, 50000000);
    has(1, CAP_REEL_FILM, 5, 0, 50000000);
    frame[1][3].at = 110000000; /* nearer to the third frame's instant than to its own */
    sets(2, CAP_NUMBERS_COUNT, "0:0 1:1 2:2 3:- 4:4");
    SAYS("cam1: 1 of 5 frames are left out");
    cap_pairs_free(&p);

    has(1, CAP_REEL_FILM, 5, 10000000000, 50000000);
    fails(2, CAP_NUMBERS_COUNT, "cam0: 0 of its 5 frames are within half a frame period (25 ms)");
    has(1, CAP_REEL_RAW, 5, 0, 50000000); /* from its trigger, and not from the begin of a film */
    fails(2, CAP_NUMBERS_COUNT, "from its own begin, and FILE from its trigger");
    has(0, CAP_REEL_RAW, 5, -100000000, 50000000);
    sets(2, CAP_NUMBERS_COUNT, "0:- 1:- 2:0 3:1 4:2 -:3 -:4");
    T_CONTAINS(p.said, "cam1 has no frame in 2 of 7 sets");
    cap_pairs_free(&p);
    has(0, CAP_REEL_FILM, 5, 0, 50000000);
    has(1, CAP_REEL_PICTURES, 5, 0, 1);
    fails(2, CAP_NUMBERS_COUNT, "is a film");
    has(0, CAP_REEL_PAGES, 5, 0, 1);
    fails(2, CAP_NUMBERS_US, "pages");
    has(1, CAP_REEL_PAGES, 4, 0, 1);
    sets(2, CAP_NUMBERS_COUNT, "0:0 1:1 2:2 3:3 4:-");
    SAYS("taken to have started together");
    cap_pairs_free(&p);
    reel[0].files = reel[1].files = 2; /* the second has lost its first file */
    reel[0].begin = 1;
    reel[1].begin = 2;
    fails(2, CAP_NUMBERS_COUNT, "is the first file of cam1");

    has(0, CAP_REEL_PICTURES, 1, 1000, 1); /* nothing tells what is near */
    has(1, CAP_REEL_PICTURES, 1, 61000, 1);
    sets(2, CAP_NUMBERS_MS, "0:0");
    SAYS("their times are 60 s apart");
    cap_pairs_free(&p);
}
