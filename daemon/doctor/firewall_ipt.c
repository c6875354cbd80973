/* firewall_ipt.c - the rules as iptables-save prints them: the filter table's INPUT. */
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "daemon/doctor/firewall.h"
#include "daemon/doctor/parse.h"

static bool doctor_is(const char *a, const char *b)
{
    return strcmp(a, b) == 0;
}

static enum doc_match doctor_option(const char *o, const char *v, const struct doc_stream *s)
{
    if (doctor_is(o, "-i") || doctor_is(o, "--in-interface"))
        return doc_match_iface(v, s->iface);
    if (doctor_is(o, "-s") || doctor_is(o, "--source"))
        return doc_match_net(v, s->address);
    if (doctor_is(o, "-p") || doctor_is(o, "--protocol"))
        return doctor_is(v, "udp") || doctor_is(v, "all") ? DOC_MATCH_YES : DOC_MATCH_NO;
    if (doctor_is(o, "-m") || doctor_is(o, "--comment") || doctor_is(o, "--reject-with"))
        return DOC_MATCH_YES; /* its conditions come in options of their own */
    if (doctor_is(o, "--dport") || doctor_is(o, "--destination-port"))
        return doc_match_ports(v);
    if (doctor_is(o, "--ctstate") || doctor_is(o, "--state"))
        return strstr(v, "NEW") != NULL ? DOC_MATCH_YES : DOC_MATCH_NO;
    return DOC_MATCH_PERHAPS;
}

/* Conditions of "-A INPUT ..." after the chain; *target: word after -j or -g. */
static enum doc_match conditions(char *p, const struct doc_stream *s, const char **target)
{
    enum doc_match m = DOC_MATCH_YES;
    char *save = NULL;
    bool negated = false;
    *target = "";
    for (char *o = strtok_r(p, " ", &save); o != NULL; o = strtok_r(NULL, " ", &save)) {
        if (doctor_is(o, "!")) {
            negated = true;
            continue;
        }
        char *v = strtok_r(NULL, " ", &save);
        if (v == NULL)
            break;
        if (v[0] == '"') /* a comment in quotes */
            while (v != NULL && (v[0] == '\0' || v[strlen(v) - 1] != '"'))
                v = strtok_r(NULL, " ", &save);
        if (doctor_is(o, "-j") || doctor_is(o, "-g")) {
            *target = v != NULL ? v : "";
            continue;
        }
        enum doc_match k = v != NULL ? doctor_option(o, v, s) : DOC_MATCH_PERHAPS;
        m = doc_match_and(m, negated ? doc_match_not(k) : k);
        negated = false;
    }
    return m;
}

enum doc_pass doc_firewall_iptables(const char *text, const struct doc_stream *s, char *why,
                                    char *chain, size_t size)
{
    char line[1024], copy[1024];
    bool filter = false, drop_policy = false, perhaps_accept = false, perhaps_drop = false;
    why[0] = chain[0] = '\0';
    while (doc_line_next(&text, line, sizeof line)) {
        const char *target;
        if (line[0] == '*')
            filter = doctor_is(line, "*filter");
        if (filter && strncmp(line, ":INPUT ", 7) == 0)
            drop_policy = strncmp(line + 7, "ACCEPT", 6) != 0;
        if (!filter || strncmp(line, "-A INPUT ", 9) != 0)
            continue;
        snprintf(copy, sizeof copy, "%s", line + 9);
        enum doc_match m = conditions(copy, s, &target);
        if (m == DOC_MATCH_NO || target[0] == '\0' || doctor_is(target, "LOG"))
            continue;
        bool accept = doctor_is(target, "ACCEPT"),
             drop = doctor_is(target, "DROP") || doctor_is(target, "REJECT");
        if (m == DOC_MATCH_YES && accept && !perhaps_drop) {
            why[0] = '\0';
            return DOC_PASS_YES;
        }
        snprintf(chain, size, "INPUT");
        snprintf(why, size, "%s", line);
        if (m == DOC_MATCH_YES && (accept || drop))
            return drop && !perhaps_accept ? DOC_PASS_NO : DOC_PASS_UNSURE;
        perhaps_accept |= !drop;
        perhaps_drop |= !accept;
    }
    if (drop_policy && !perhaps_accept) {
        snprintf(chain, size, "INPUT");
        snprintf(why, size, "policy DROP");
        return DOC_PASS_NO;
    }
    if (drop_policy ? perhaps_accept : perhaps_drop)
        return DOC_PASS_UNSURE;
    why[0] = '\0';
    return DOC_PASS_YES;
}
