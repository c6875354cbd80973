/* firewall_nft.c - the rules as `nft -j list ruleset` prints them (libnftables-json(5)). */
#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "daemon/doctor/firewall.h"

enum end { END_NONE, END_ACCEPT, END_DROP, END_CHAIN, END_RETURN };

static const cJSON *doctor_get(const cJSON *j, const char *key)
{
    return cJSON_GetObjectItemCaseSensitive(j, key);
}

static const char *doctor_text(const cJSON *j, const char *key)
{
    const char *s = cJSON_GetStringValue(doctor_get(j, key));
    return s != NULL ? s : "";
}

static bool firewall_nft_is(const char *a, const char *b)
{
    return strcmp(a, b) == 0;
}

static bool any(const char *word, const char *const *list)
{
    while (*list != NULL && !firewall_nft_is(word, *list))
        list++;
    return *list != NULL;
}

/* ---- conditions ------------------------------------------------------------------------------- */

static enum doc_match yes_if(bool yes)
{
    return yes ? DOC_MATCH_YES : DOC_MATCH_NO;
}

enum field { NOT_KNOWN, IFACE, SOURCE, PORT, FROM_PORT, PROTOCOL, STATE, FAMILY };

static const struct known {
    const char *name;
    enum field field;
} all_known[] = {
    {"meta iif", IFACE},       {"meta iifname", IFACE},  {"meta l4proto", PROTOCOL},
    {"meta protocol", FAMILY}, {"meta nfproto", FAMILY}, {"ct state", STATE},
    {"udp sport", FROM_PORT},  {"udp dport", PORT},      {"ip saddr", SOURCE},
    {"ip protocol", PROTOCOL},
};

static enum doc_match matches(enum field field, const char *v, const struct doc_stream *s)
{
    switch (field) {
    case IFACE: return doc_match_iface(v, s->iface);
    case SOURCE: return doc_match_net(v, s->address);
    case PORT: return doc_match_ports(v);
    case FROM_PORT: return doc_match_and(doc_match_ports(v), DOC_MATCH_PERHAPS);
    case PROTOCOL: return yes_if(firewall_nft_is(v, "udp"));
    case STATE: return yes_if(firewall_nft_is(v, "new"));
    case FAMILY: return yes_if(firewall_nft_is(v, "ipv4") || firewall_nft_is(v, "ip"));
    case NOT_KNOWN: break;
    }
    return DOC_MATCH_PERHAPS;
}

/* What the left side of a condition asks: {"meta": {"key": "iifname"}} and the like.  false: a
 * packet of the stream has no such field; *out NOT_KNOWN: it is not understood. */
static bool asks(const cJSON *left, enum field *out)
{
    static const char *const others[] = {"tcp", "icmp", "icmpv6", "ip6", "sctp", NULL};
    const cJSON *what = left != NULL ? left->child : NULL;
    const char *group = what != NULL ? what->string : "", *field = doctor_text(what, "key");
    char name[64];
    *out = NOT_KNOWN;
    if (firewall_nft_is(group, "payload")) {
        group = doctor_text(what, "protocol");
        field = doctor_text(what, "field");
    }
    if (any(group, others))
        return false;
    snprintf(name, sizeof name, "%s %s", group, field);
    for (size_t i = 0; i < sizeof all_known / sizeof all_known[0]; i++)
        if (firewall_nft_is(name, all_known[i].name))
            *out = all_known[i].field;
    return true;
}

/* A word, a number, {"prefix": {"addr", "len"}} or {"range": [first, last]}; "@set" is not known. */
static enum doc_match doctor_value(const cJSON *v, enum field field, const struct doc_stream *s)
{
    char one[64];
    const cJSON *prefix = doctor_get(v, "prefix"), *range = doctor_get(v, "range");
    const cJSON *lo = cJSON_GetArrayItem(range, 0), *hi = cJSON_GetArrayItem(range, 1);
    const cJSON *len = doctor_get(prefix, "len");
    if (cJSON_IsString(v) && v->valuestring[0] != '@')
        return matches(field, v->valuestring, s);
    if (cJSON_IsNumber(v))
        snprintf(one, sizeof one, "%d", v->valueint);
    else if (cJSON_IsNumber(len))
        snprintf(one, sizeof one, "%s/%d", doctor_text(prefix, "addr"), len->valueint);
    else if (cJSON_IsNumber(lo) && cJSON_IsNumber(hi))
        snprintf(one, sizeof one, "%d-%d", lo->valueint, hi->valueint);
    else
        return DOC_MATCH_PERHAPS;
    return matches(field, one, s);
}

static enum doc_match doctor_condition(const cJSON *match, const struct doc_stream *s)
{
    const char *op = doctor_text(match, "op");
    const cJSON *right = doctor_get(match, "right"), *set = doctor_get(right, "set"), *v;
    enum field field;
    if (!asks(doctor_get(match, "left"), &field))
        return DOC_MATCH_NO;
    if (field == NOT_KNOWN ||
        (!firewall_nft_is(op, "==") && !firewall_nft_is(op, "!=") && !firewall_nft_is(op, "in")))
        return DOC_MATCH_PERHAPS;
    const cJSON *list = set != NULL ? set : right;
    enum doc_match m = DOC_MATCH_NO;
    if (cJSON_IsArray(list))
        cJSON_ArrayForEach(v, list)
        {
            enum doc_match k = doctor_value(v, field, s);
            if (k == DOC_MATCH_YES || m == DOC_MATCH_NO)
                m = k;
        }
    else
        m = doctor_value(right, field, s);
    return firewall_nft_is(op, "!=") ? doc_match_not(m) : m;
}

/* ---- rules ------------------------------------------------------------------------------------ */

static enum end doctor_verdict(const char *word)
{
    static const char *const drops[] = {"drop", "reject", NULL};
    static const char *const chains[] = {"jump", "goto", "queue", NULL};
    return firewall_nft_is(word, "accept")   ? END_ACCEPT
           : any(word, drops)                ? END_DROP
           : any(word, chains)               ? END_CHAIN
           : firewall_nft_is(word, "return") ? END_RETURN
                                             : END_NONE;
}

/* {"vmap": {"key", "data": {"set": [[value, verdict], ...]}}} */
static enum end mapped(const cJSON *vmap, const struct doc_stream *s)
{
    const cJSON *set = doctor_get(doctor_get(vmap, "data"), "set"), *pair;
    enum field field;
    if (!asks(doctor_get(vmap, "key"), &field))
        return END_NONE;
    if (field == NOT_KNOWN || !cJSON_IsArray(set))
        return END_CHAIN;
    cJSON_ArrayForEach(pair, set)
    {
        const cJSON *to = cJSON_GetArrayItem(pair, 1);
        enum doc_match m = doctor_value(cJSON_GetArrayItem(pair, 0), field, s);
        if (m != DOC_MATCH_NO)
            return m == DOC_MATCH_YES && cJSON_IsObject(to) && to->child != NULL
                       ? doctor_verdict(to->child->string)
                       : END_CHAIN;
    }
    return END_NONE;
}

/* How the rule ends for a packet of the stream, if its conditions (*m) hold; *by: the statement. */
static enum end evaluate(const cJSON *rule, const struct doc_stream *s, enum doc_match *m,
                         const cJSON **by)
{
    static const char *const nothing[] = {"counter", "log", "vmap", NULL};
    const cJSON *statement;
    *m = DOC_MATCH_YES;
    cJSON_ArrayForEach(statement, doctor_get(rule, "expr"))
    {
        const cJSON *what = statement->child;
        const char *word = what != NULL && what->string != NULL ? what->string : "";
        enum end end = firewall_nft_is(word, "vmap") ? mapped(what, s) : doctor_verdict(word);
        *by = what;
        if (end != END_NONE)
            return end;
        if (firewall_nft_is(word, "match"))
            *m = doc_match_and(*m, doctor_condition(what, s));
        else if (!any(word, nothing))
            *m = doc_match_and(*m, DOC_MATCH_PERHAPS);
    }
    return END_NONE;
}

static bool of_chain(const cJSON *rule, const cJSON *chain)
{
    return firewall_nft_is(doctor_text(rule, "family"), doctor_text(chain, "family")) &&
           firewall_nft_is(doctor_text(rule, "table"), doctor_text(chain, "table")) &&
           firewall_nft_is(doctor_text(rule, "chain"), doctor_text(chain, "name"));
}

static enum doc_pass walk(const cJSON *list, const cJSON *chain, const struct doc_stream *s,
                          char *why, size_t size)
{
    bool drop = firewall_nft_is(doctor_text(chain, "policy"), "drop"), decided = false;
    bool perhaps_accept = false, perhaps_drop = false;
    const cJSON *item, *by = NULL;
    why[0] = '\0';
    cJSON_ArrayForEach(item, list)
    {
        const cJSON *rule = doctor_get(item, "rule");
        enum doc_match m;
        if (decided || rule == NULL || !of_chain(rule, chain))
            continue;
        enum end end = evaluate(rule, s, &m, &by);
        if (end == END_NONE || m == DOC_MATCH_NO)
            continue;
        decided = m == DOC_MATCH_YES && end != END_CHAIN;
        if (decided) {
            drop = end == END_RETURN ? drop : end == END_DROP;
        } else {
            perhaps_drop |= end == END_DROP || end == END_CHAIN;
            perhaps_accept |= end != END_DROP;
        }
        const cJSON *handle = doctor_get(rule, "handle");
        const char *target = doctor_text(by, "target");
        if (!decided || (drop && !perhaps_accept))
            snprintf(why, size, "%s%s%s (handle %d in `nft -a list ruleset`)", by->string,
                     target[0] != '\0' ? " " : "", target, handle != NULL ? handle->valueint : 0);
    }
    if (drop && !perhaps_accept && !decided)
        snprintf(why, size, "policy drop");
    return drop ? (perhaps_accept ? DOC_PASS_UNSURE : DOC_PASS_NO)
                : (perhaps_drop ? DOC_PASS_UNSURE : DOC_PASS_YES);
}

enum doc_pass doc_firewall_nft(const char *rules, const struct doc_stream *s, char *why,
                               char *chain, size_t size)
{
    static const char *const ways_in[] = {"input", "prerouting", "ingress", NULL};
    cJSON *root = cJSON_Parse(rules);
    const cJSON *list = doctor_get(root, "nftables"), *item;
    enum doc_pass all = DOC_PASS_YES;
    why[0] = chain[0] = '\0';
    if (!cJSON_IsArray(list)) {
        snprintf(why, size, "an answer of nft that is not its JSON");
        all = DOC_PASS_UNSURE;
    }
    cJSON_ArrayForEach(item, list)
    {
        const cJSON *c = doctor_get(item, "chain");
        char reason[256];
        if (!firewall_nft_is(doctor_text(c, "type"), "filter") ||
            !any(doctor_text(c, "hook"), ways_in))
            continue;
        enum doc_pass p = walk(list, c, s, reason, sizeof reason);
        /* NO beats UNSURE beats YES */
        if (all == DOC_PASS_NO || p == DOC_PASS_YES || p == all)
            continue;
        snprintf(why, size, "%s", reason);
        snprintf(chain, size, "%s %s %s", doctor_text(c, "family"), doctor_text(c, "table"),
                 doctor_text(c, "name"));
        all = p;
    }
    cJSON_Delete(root);
    return all;
}
