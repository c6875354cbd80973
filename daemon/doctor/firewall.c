/* firewall.c - conditions that nftables and iptables have in common. */
#include "daemon/doctor/firewall.h"

#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum doc_match doc_match_and(enum doc_match a, enum doc_match b)
{
    if (a == DOC_MATCH_NO || b == DOC_MATCH_NO)
        return DOC_MATCH_NO;
    return a == DOC_MATCH_PERHAPS || b == DOC_MATCH_PERHAPS ? DOC_MATCH_PERHAPS : DOC_MATCH_YES;
}

enum doc_match doc_match_not(enum doc_match m)
{
    return m == DOC_MATCH_NO ? DOC_MATCH_YES : m == DOC_MATCH_YES ? DOC_MATCH_NO : m;
}

enum doc_match doc_match_iface(const char *pattern, const char *iface)
{
    size_t n = strlen(pattern);
    if (n > 0 && (pattern[n - 1] == '*' || pattern[n - 1] == '+'))
        return strncmp(pattern, iface, n - 1) == 0 ? DOC_MATCH_YES : DOC_MATCH_NO;
    return strcmp(pattern, iface) == 0 ? DOC_MATCH_YES : DOC_MATCH_NO;
}

enum doc_match doc_match_net(const char *net, uint32_t address)
{
    char text[32];
    struct in_addr a;
    size_t n = strcspn(net, "/");
    long bits = 32;
    if (n >= sizeof text)
        return DOC_MATCH_PERHAPS;
    snprintf(text, sizeof text, "%.*s", (int)n, net);
    if (net[n] == '/') {
        char *end;
        bits = strtol(net + n + 1, &end, 10);
        if (*end != '\0' || end == net + n + 1 || bits < 0 || bits > 32)
            return DOC_MATCH_PERHAPS;
    }
    if (inet_pton(AF_INET, text, &a) != 1)
        return DOC_MATCH_PERHAPS;
    uint32_t mask = bits == 0 ? 0 : ~(uint32_t)0 << (32 - bits);
    if (bits == 0)
        return DOC_MATCH_YES;
    if (address == 0)
        return DOC_MATCH_PERHAPS;
    return ((ntohl(a.s_addr) ^ address) & mask) == 0 ? DOC_MATCH_YES : DOC_MATCH_NO;
}

enum doc_match doc_match_ports(const char *range)
{
    char *end;
    long lo = strtol(range, &end, 10), hi = lo;
    if (end == range)
        return DOC_MATCH_PERHAPS;
    if (*end == '-' || *end == ':') {
        const char *p = end + 1;
        hi = strtol(p, &end, 10);
        if (end == p)
            hi = 65535;
    }
    if (*end != '\0')
        return DOC_MATCH_PERHAPS;
    if (lo <= 1024 && hi >= 60999)
        return DOC_MATCH_YES;
    return lo == hi || hi < 1024 ? DOC_MATCH_NO : DOC_MATCH_PERHAPS;
}
