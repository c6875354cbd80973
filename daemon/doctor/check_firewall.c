/* check_firewall.c - do the host's rules let streams and replies of cameras in? */
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/firewall.h"

#define RULES_MAX (1 << 20)

typedef enum doc_pass reader(const char *text, const struct doc_stream *s, char *why, char *chain,
                             size_t size);

static void judge(struct doctor *d, const char *tool, enum doc_pass pass, const char *link,
                  const char *why, const char *chain)
{
    if (doc_settled(pass == DOC_PASS_YES, d, DOC_OK, 96, "net.firewall",
                    "%s lets cameras' packets in on %s", tool, link))
        return;
    bool nft = strcmp(tool, "nftables") == 0;
    struct doc_finding *f =
        pass == DOC_PASS_NO
            ? doc_say(d, DOC_FAIL, 96, "net.firewall", "%s keeps cameras' packets out on %s: %s",
                      tool, link, why)
            : doc_say(d, DOC_UNKNOWN, 80, "net.firewall",
                      "%s may keep cameras' packets out on %s; it depends on: %s", tool, link, why);
    doc_means(f, "cameras are not found (replies from UDP port 3956), or are found and no frame "
                 "ever comes (the stream goes to a port above 1023, and the camera speaks first)");
    if (d->host->root[0] == '\0' && doc_process(d->host, "firewalld", NULL))
        doc_command(f,
                    "firewall-cmd --permanent --zone=trusted --change-interface=%s && "
                    "firewall-cmd --reload",
                    doc_quote(link));
    else if (strstr(why, "ufw") != NULL || strstr(chain, "ufw") != NULL)
        doc_command(f, "ufw allow in on %s proto udp from any", doc_quote(link));
    else if (nft)
        doc_command(f, "nft insert rule %s iifname %s meta l4proto udp accept", chain,
                    doc_quote(link));
    else
        doc_command(f, "iptables -I %s -i %s -p udp -j ACCEPT", chain, doc_quote(link));
    doc_note(f, "keep it where your rules are kept (/etc/nftables.conf, netfilter-persistent)");
}

/* Ask one tool; false: it gave no usable answer (d says why). */
static bool rules(struct doctor *d, const char *tool, const char *const *argv, reader *read,
                  struct pvx_diag *diag)
{
    char *text = malloc(RULES_MAX);
    if (text == NULL)
        return false;
    text[0] = '\0';
    pvx_err e = d->host->run(d->host, argv, text, RULES_MAX, diag);
    bool cut = strlen(text) >= RULES_MAX - 1;
    for (size_t i = 0; i < d->n_links && e == PVX_OK && !cut; i++) {
        char why[256], chain[256];
        struct doc_stream s = {d->link[i].name, d->link[i].address};
        enum doc_pass p = read(text, &s, why, chain, sizeof why);
        judge(d, tool, p, d->link[i].name, why, chain);
    }
    free(text);
    if (cut)
        (void)pvx_fail(diag, PVX_ERANGE, "%s has more rules than are read here", tool);
    return e == PVX_OK && !cut;
}

void doc_check_firewall(struct doctor *d)
{
    static const char *const nft[] = {"nft", "-j", "list", "ruleset", NULL};
    static const char *const ipt[] = {"iptables-save", NULL};
    char names[256] = "";
    struct pvx_diag a = {""}, b = {""};
    if (d->n_links == 0)
        return;
    bool tables =
        doc_text(d->host, names, sizeof names, "/proc/net/ip_tables_names") && names[0] != '\0';
    bool have_nf = doc_exists(d->host, "/sys/module/nf_tables");
    bool told = rules(d, "nftables", nft, doc_firewall_nft, &a);
    /* the older tables exist beside nftables and both must let a packet pass */
    if ((tables || !told) && rules(d, "iptables", ipt, doc_firewall_iptables, &b))
        told = true;
    if (told)
        return;
    if (doc_settled(!have_nf && !tables && doc_exists(d->host, "/proc/net/ip_tables_names"), d,
                    DOC_OK, 96, "net.firewall", "no firewall rules are loaded"))
        return;
    struct doc_finding *f = doc_say(d, DOC_UNKNOWN, 60, "net.firewall", "firewall: %s; %s",
                                    a.text[0] != '\0' ? a.text : "nft gave nothing",
                                    b.text[0] != '\0' ? b.text : "iptables-save gave nothing");
    doc_means(f, "rules that drop UDP keep cameras from being found, or their streams out");
    doc_note(f, "run `sudo pyrovox doctor`, or look at `nft list ruleset` yourself");
}
