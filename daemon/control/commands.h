/* commands.h - the table of the daemon's commands.  The control socket, `pyrovox ctl --help` and the test of CONTROL.md
 * follow from it.
 * Threads: constant; the answers come from the control thread. */
#ifndef DMN_COMMANDS_H
#define DMN_COMMANDS_H
#include "daemon/control/control.h"

#define DMN_CONTROL_VERSION 1

struct dmn_answer { /* where an answer goes */
    char *text;
    size_t size;
};
struct cJSON;

struct dmn_command {
    const char *name;
    const char *keys;  /* allowed in its request, in the order of ctl's words: "key value" */
    const char *usage; /* the words, as ctl --help shows them */
    const char *help;
    /* length of the answer, a JSON object; 0 = it did not fit */
    size_t (*answer)(const struct dmn_control_ops *ops, const struct cJSON *request,
                     struct dmn_answer to);
};
extern const struct dmn_command dmn_commands[];
extern const size_t dmn_n_commands;
/* NULL: there is none of this name. */
const struct dmn_command *dmn_command_find(const char *name);

/* {"error":...} */
size_t dmn_answer_error(struct dmn_answer to, const char *text);

/* get and set (settings.c) */
size_t dmn_answer_get(const struct dmn_control_ops *ops, const struct cJSON *request,
                      struct dmn_answer to);
size_t dmn_answer_set(const struct dmn_control_ops *ops, const struct cJSON *request,
                      struct dmn_answer to);

#endif
