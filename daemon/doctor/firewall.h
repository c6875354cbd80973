/* firewall.h - would this set of rules let a GigE camera's stream in?
 *
 * The stream is UDP from the camera's address to a port of ours above 1023, arriving on one
 * interface; connection tracking does not know it (the camera speaks first), so rules for
 * established connections do not let it in.  Rules are walked in their order; a condition that is
 * not understood makes the rule a "perhaps".  Pure, for any bytes (fuzzed).
 * Formats: `nft -j list ruleset` (libnftables-json(5)), iptables-save(8). */
#ifndef DOC_FIREWALL_H
#define DOC_FIREWALL_H
#include <stddef.h>
#include <stdint.h>

enum doc_pass { DOC_PASS_YES, DOC_PASS_NO, DOC_PASS_UNSURE };

struct doc_stream {
    const char *iface;
    uint32_t address; /* camera's, host order; 0 = not known */
};
/* why [size]: the rule or policy that decides, "" when nothing stands in the way; chain [size]:
 * where an accepting rule would go, as "inet filter input" or "INPUT". */
enum doc_pass doc_firewall_nft(const char *text, const struct doc_stream *s, char *why, char *chain,
                               size_t size);
enum doc_pass doc_firewall_iptables(const char *text, const struct doc_stream *s, char *why,
                                    char *chain, size_t size);

/* Shared by the two readers. */
enum doc_match { DOC_MATCH_NO, DOC_MATCH_YES, DOC_MATCH_PERHAPS };
/* Whether both conditions hold. */
enum doc_match doc_match_and(enum doc_match a, enum doc_match b);
enum doc_match doc_match_not(enum doc_match m);
/* "eth0", "eth*" (nft) or "eth+" (iptables) against the interface. */
enum doc_match doc_match_iface(const char *pattern, const char *iface);
/* "192.168.1.0/24" or an address, against the camera's. */
enum doc_match doc_match_net(const char *net, uint32_t address);
/* "3956", "1024-65535" or "1024:65535" against all ports from 1024 on: YES, when all are in it. */
enum doc_match doc_match_ports(const char *range);
#endif
