/* firewall_nft.c - the rules as `nft list ruleset` prints them. */
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "doctor/firewall.h"
#include "doctor/parse.h"

#define MAX_TOKENS 64

enum end { END_NONE, END_ACCEPT, END_DROP, END_CHAIN, END_RETURN };

struct rule {
    size_t n, i;
    char *t[MAX_TOKENS];
    enum doc_match match;
    enum end end;
};

/* Cut a line into words; what stands in quotes is one, without them. */
static void tokens(char *line, struct rule *r)
{
    char *p = line;
    r->n = r->i = 0;
    while (r->n < MAX_TOKENS) {
        p += strspn(p, " \t");
        if (*p == '\0' || *p == '#')
            break;
        char *end;
        if (*p == '"') {
            r->t[r->n++] = ++p;
            end = p + strcspn(p, "\"");
        } else {
            r->t[r->n++] = p;
            end = p + strcspn(p, " \t");
        }
        if (*end == '\0')
            break;
        *end = '\0';
        p = end + 1;
    }
}

static const char *next(struct rule *r)
{
    return r->i < r->n ? r->t[r->i++] : "";
}

typedef enum doc_match match_fn(const char *value, const struct doc_stream *s);
static enum doc_match is_iface(const char *v, const struct doc_stream *s)
{
    return doc_match_iface(v, s->iface);
}
static enum doc_match is_source(const char *v, const struct doc_stream *s)
{
    return v[0] == '@' ? DOC_MATCH_PERHAPS : doc_match_net(v, s->address);
}
static enum doc_match is_port(const char *v, const struct doc_stream *s)
{
    (void)s;
    return doc_match_ports(v);
}
static enum doc_match is_udp(const char *v, const struct doc_stream *s)
{
    (void)s;
    return strcmp(v, "udp") == 0 || strcmp(v, "17") == 0 ? DOC_MATCH_YES : DOC_MATCH_NO;
}
static enum doc_match is_new(const char *v, const struct doc_stream *s)
{
    (void)s;
    return strstr(v, "new") != NULL || strcmp(v, "0x8") == 0 || strcmp(v, "8") == 0 ? DOC_MATCH_YES
                                                                                    : DOC_MATCH_NO;
}
static enum doc_match is_ipv4(const char *v, const struct doc_stream *s)
{
    (void)s;
    return strcmp(v, "ipv4") == 0 || strcmp(v, "ip") == 0 || strcmp(v, "2") == 0 ? DOC_MATCH_YES
                                                                                 : DOC_MATCH_NO;
}

/* [!=] value, or [!=] { value, value } */
static enum doc_match values(struct rule *r, match_fn *is, const struct doc_stream *s)
{
    const char *v = next(r);
    bool negated = strcmp(v, "!=") == 0;
    if (negated)
        v = next(r);
    enum doc_match m = DOC_MATCH_NO;
    if (strcmp(v, "{") != 0) {
        m = is(v, s);
    } else {
        while (*(v = next(r)) != '\0' && strcmp(v, "}") != 0) {
            char one[64];
            snprintf(one, sizeof one, "%.*s", (int)strcspn(v, ","), v);
            enum doc_match k = is(one, s);
            if (k == DOC_MATCH_YES || m == DOC_MATCH_NO)
                m = k;
        }
    }
    return negated ? doc_match_not(m) : m;
}

static bool is(const char *a, const char *b)
{
    return strcmp(a, b) == 0;
}

/* One condition or statement of the rule, which begins with word w. */
static enum doc_match condition(struct rule *r, const char *w, const struct doc_stream *s)
{
    if (is(w, "iif") || is(w, "iifname"))
        return values(r, is_iface, s);
    if (is(w, "counter") || is(w, "comment") || is(w, "log") || is(w, "packets") ||
        is(w, "bytes") || is(w, "prefix") || is(w, "level")) {
        if (!is(w, "counter") && !is(w, "log"))
            next(r);
        return DOC_MATCH_YES;
    }
    if (is(w, "tcp") || is(w, "icmp") || is(w, "icmpv6") || is(w, "ip6") || is(w, "sctp"))
        return DOC_MATCH_NO;
    if (is(w, "udp")) {
        const char *what = next(r);
        return is(what, "dport")   ? values(r, is_port, s)
               : is(what, "sport") ? doc_match_and(values(r, is_port, s), DOC_MATCH_PERHAPS)
                                   : DOC_MATCH_PERHAPS;
    }
    if (is(w, "ct")) {
        const char *what = next(r);
        return is(what, "state") ? values(r, is_new, s) : DOC_MATCH_PERHAPS;
    }
    if (is(w, "ip") || is(w, "meta")) {
        const char *what = next(r);
        if (is(what, "saddr"))
            return values(r, is_source, s);
        if (is(what, "protocol") || is(what, "l4proto"))
            return is(w, "meta") && is(what, "protocol") ? values(r, is_ipv4, s)
                                                         : values(r, is_udp, s);
        if (is(what, "iif") || is(what, "iifname"))
            return values(r, is_iface, s);
        if (is(what, "nfproto"))
            return values(r, is_ipv4, s);
    }
    return DOC_MATCH_PERHAPS;
}

static void evaluate(struct rule *r, const struct doc_stream *s)
{
    r->match = DOC_MATCH_YES;
    r->end = END_NONE;
    while (r->i < r->n && r->end == END_NONE) {
        const char *w = next(r);
        if (is(w, "accept"))
            r->end = END_ACCEPT;
        else if (is(w, "drop") || is(w, "reject"))
            r->end = END_DROP;
        else if (is(w, "jump") || is(w, "goto") || is(w, "queue") || is(w, "vmap"))
            r->end = END_CHAIN;
        else if (is(w, "return"))
            r->end = END_RETURN;
        else
            r->match = doc_match_and(r->match, condition(r, w, s));
    }
}

/* State of the walk through one chain. */
struct walk {
    bool base;    /* packets from outside come through here */
    bool decided; /* a rule that surely applies has ended it */
    bool drop;    /* by policy */
    bool perhaps_accept, perhaps_drop;
    enum doc_pass result;
    char why[256], table[128], name[128];
};

static void rule(struct walk *w, const char *line, const struct doc_stream *s)
{
    struct rule r;
    char copy[1024];
    snprintf(copy, sizeof copy, "%s", line);
    tokens(copy, &r);
    evaluate(&r, s);
    if (w->decided || r.match == DOC_MATCH_NO || r.end == END_NONE)
        return;
    bool drop = r.end == END_DROP, sure = r.match == DOC_MATCH_YES;
    if (r.end == END_CHAIN) {
        w->perhaps_accept = w->perhaps_drop = true;
        snprintf(w->why, sizeof w->why, "%s", line);
    } else if (!sure) {
        w->perhaps_drop |= drop;
        w->perhaps_accept |= r.end == END_ACCEPT || r.end == END_RETURN;
        snprintf(w->why, sizeof w->why, "%s", line);
    } else {
        w->decided = true;
        if (r.end == END_RETURN)
            drop = w->drop;
        w->result = drop ? (w->perhaps_accept ? DOC_PASS_UNSURE : DOC_PASS_NO)
                         : (w->perhaps_drop ? DOC_PASS_UNSURE : DOC_PASS_YES);
        if (drop && !w->perhaps_accept)
            snprintf(w->why, sizeof w->why, "%s", line);
    }
}

static void end_chain(struct walk *w, enum doc_pass *all, char *why, char *chain, size_t size)
{
    if (w->base && !w->decided) {
        w->result = w->drop ? (w->perhaps_accept ? DOC_PASS_UNSURE : DOC_PASS_NO)
                            : (w->perhaps_drop ? DOC_PASS_UNSURE : DOC_PASS_YES);
        if (w->result == DOC_PASS_NO)
            snprintf(w->why, sizeof w->why, "policy drop");
    }
    /* NO beats UNSURE beats YES */
    if (w->base &&
        (w->result == DOC_PASS_NO || (w->result == DOC_PASS_UNSURE && *all == DOC_PASS_YES))) {
        if (*all != DOC_PASS_NO) {
            snprintf(why, size, "%s", w->why);
            snprintf(chain, size, "%s %s", w->table, w->name);
        }
        *all = w->result;
    }
    *w = (struct walk){.result = DOC_PASS_YES};
}

enum doc_pass doc_firewall_nft(const char *text, const struct doc_stream *s, char *why, char *chain,
                               size_t size)
{
    char line[1024], table[128] = "";
    enum doc_pass all = DOC_PASS_YES;
    struct walk w = {.result = DOC_PASS_YES};
    bool in_chain = false;
    why[0] = chain[0] = '\0';
    while (doc_line_next(&text, line, sizeof line)) {
        char *p = line + strspn(line, " \t");
        size_t n = strlen(p);
        if (strncmp(p, "table ", 6) == 0) {
            snprintf(table, sizeof table, "%.*s", (int)strcspn(p + 6, "{"), p + 6);
            for (n = strlen(table); n > 0 && table[n - 1] == ' ';)
                table[--n] = '\0';
        } else if (strncmp(p, "chain ", 6) == 0) {
            end_chain(&w, &all, why, chain, size);
            snprintf(w.table, sizeof w.table, "%s", table);
            snprintf(w.name, sizeof w.name, "%.*s", (int)strcspn(p + 6, " {"), p + 6);
            in_chain = true;
        } else if (in_chain && strcmp(p, "}") == 0) {
            end_chain(&w, &all, why, chain, size);
            in_chain = false;
        } else if (in_chain && strncmp(p, "type ", 5) == 0) {
            bool way_in = strstr(p, "hook input") != NULL || strstr(p, "hook prerouting") != NULL ||
                          strstr(p, "hook ingress") != NULL;
            w.base = strncmp(p, "type filter", 11) == 0 && way_in;
            w.drop = strstr(p, "policy drop") != NULL;
        } else if (in_chain && w.base && n > 0) {
            rule(&w, p, s);
        }
    }
    end_chain(&w, &all, why, chain, size);
    return all;
}
