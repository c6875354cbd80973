/* options.h - the table of all keys of pyrovoxd.yaml.
 *
 * The table alone drives the reader, --print-config, --check-config, the example file and the test
 * of the man page.  A default is written as it would stand in the file and read by the same code.
 * Keys are paths of at most two words: "fps", "sync.policy"; options of one section stand together.
 * Threads: constant. */
#ifndef DMN_OPTIONS_H
#define DMN_OPTIONS_H
#include <stdbool.h>
#include <stddef.h>

enum dmn_type {
    DMN_BOOL,    /* int */
    DMN_INT,     /* int64_t in [min,max] */
    DMN_REAL,    /* double in [min,max] */
    DMN_TEXT,    /* char[size] */
    DMN_WHERE,   /* char[size]: words of compute.h */
    DMN_CHOICE,  /* int: index into `choices` */
    DMN_FORMAT,  /* int: enum cap_pixfmt, 0 = auto */
    DMN_INTS,    /* struct dmn_ints, each in [min,max] */
    DMN_TEXTS,   /* struct dmn_texts */
    DMN_PAIRS,   /* struct dmn_pairs: a mapping of words to words */
    DMN_CAMERAS, /* struct dmn_pairs: a mapping, or one pattern for all (key "") */
    DMN_RING,    /* struct dmn_ring (triggers.h) */
    DMN_TRIGGERS /* struct dmn_triggers (triggers.h) */
};

#define DMN_WORD_MAX  256
#define DMN_PAIRS_MAX 64
#define DMN_TEXTS_MAX 8

struct dmn_ints {
    size_t n;
    long long v[3];
};
struct dmn_texts {
    size_t n;
    char v[DMN_TEXTS_MAX][DMN_WORD_MAX];
};
struct dmn_pairs {
    size_t n;
    struct {
        char key[64], value[DMN_WORD_MAX];
    } item[DMN_PAIRS_MAX];
};

struct dmn_option {
    const char *key;
    enum dmn_type type;
    size_t offset, size; /* in struct dmn_config */
    const char *def;     /* YAML text */
    double min, max;     /* DMN_INT, DMN_REAL, DMN_INTS */
    const char *unit;    /* "" where there is none */
    const char *choices; /* "a|b|c" for DMN_CHOICE, else NULL */
    const char *help;    /* one or two sentences */
};

extern const struct dmn_option dmn_options[];
extern const size_t dmn_n_options;

/* By its key; NULL: there is none. */
const struct dmn_option *dmn_option_find(const char *key);
/* Whether a running daemon takes another value.  The other options size or open something at the start. */
bool dmn_option_live(const struct dmn_option *o);
/* The key that is most like a mistyped one. */
const char *dmn_option_nearest(const char *key);
/* Word number `index` of "a|b|c" into out (cut to size), "" when there is none. */
void dmn_choice_word(const char *choices, int index, char *out, size_t size);

#endif
