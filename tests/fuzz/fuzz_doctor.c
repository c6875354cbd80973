/* fuzz_doctor.c - any bytes as a file of the kernel or the rules of a firewall: every reader. */
#include <string.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/firewall.h"
#include "daemon/doctor/parse.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char *text = malloc(size + 1), word[16], why[64], chain[64];
    if (text == NULL)
        return 0;
    memcpy(text, data, size);
    text[size] = '\0';
    uint64_t a, b;
    struct doc_softnet softnet;
    struct doc_route route[8];
    struct doc_irqs irqs;
    struct doc_stream s = {"eth0", 0xC0A80A0B};
    (void)doc_parse_limit(text, "Max open files", &a, &b);
    (void)doc_parse_key(text, "flags", word, sizeof word);
    MUST(strlen(word) < sizeof word);
    (void)doc_parse_key_int(text, "CapEff", 16, &a);
    (void)doc_parse_snmp(text, "Udp", "RcvbufErrors", &a);
    doc_parse_softnet(text, &softnet);
    (void)doc_parse_udp(text);
    MUST(doc_parse_routes(text, route, 8) <= 8);
    doc_parse_interrupts(text, "eth0", &irqs);
    MUST(irqs.cpus <= 256);
    (void)doc_parse_unit(text, "LimitRTPRIO", word, sizeof word);
    MUST(strlen(word) < sizeof word);
    doc_bracketed(text, word, sizeof word);
    (void)doc_has_word(text, "avx2");
    (void)doc_count_list(text);
    MUST(strlen(doc_quote(text)) < 300);
    enum doc_pass nft = doc_firewall_nft(text, &s, why, chain, sizeof why);
    enum doc_pass ipt = doc_firewall_iptables(text, &s, why, chain, sizeof why);
    fuzz_taken += nft < DOC_PASS_UNSURE || ipt < DOC_PASS_UNSURE;
    MUST(nft <= DOC_PASS_UNSURE && ipt <= DOC_PASS_UNSURE && strlen(why) < sizeof why);
    free(text);
    return 0;
}
