/* have_addresses.h - addresses that a private network has, or that somebody added by hand. */
#ifndef HAVE_ADDRESSES_H
#define HAVE_ADDRESSES_H
#include <arpa/inet.h>
#include <ifaddrs.h>
#include <stdbool.h>
#include <string.h>

#include "capture/gevsim/netns.h"

static inline bool on_interface(const struct ifaddrs *list, const char *text)
{
    struct in_addr want;
    if (inet_pton(AF_INET, text, &want) != 1)
        return false;
    for (const struct ifaddrs *p = list; p != NULL; p = p->ifa_next) {
        if (p->ifa_addr == NULL || p->ifa_addr->sa_family != AF_INET)
            continue;
        struct sockaddr_in sa;
        memcpy(&sa, p->ifa_addr, sizeof sa);
        if (sa.sin_addr.s_addr == want.s_addr)
            return true;
    }
    return false;
}

/* True when all n addresses from `first` on belong to interfaces of this host: then no private
 * network is needed to serve cameras on them. */
static inline bool have_addresses(const char *first, unsigned n)
{
    struct ifaddrs *list;
    if (getifaddrs(&list) != 0)
        return false;
    bool all = true;
    for (unsigned i = 0; all && i < n; i++) {
        char text[16];
        all = cap_netns_address(first, i, text) == PVX_OK && on_interface(list, text);
    }
    freeifaddrs(list);
    return all;
}
#endif
