/* check_system.c - kernel and machine. */
#include <stdio.h>
#include <stdlib.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/parse.h"

static void kernel(struct doctor *d)
{
    char version[128];
    int major = 0, minor = 0;
    if (doc_settled(!doc_text(d->host, version, sizeof version, "/proc/sys/kernel/osrelease") ||
                        sscanf(version, "%d.%d", &major, &minor) != 2,
                    d, DOC_UNKNOWN, 10, "kernel", "the kernel's version cannot be read"))
        return;
    if (major > 5 || (major == 5 && minor >= 10)) {
        doc_say(d, DOC_OK, 26, "kernel", "Linux %s", version);
        return;
    }
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 26, "kernel",
                "Linux %s is older than the oldest that Pyrovox is tested with (5.10)", version);
    doc_means(f, "drivers of cameras and network cards may have faults that newer kernels fixed");
    doc_command(f, "apt-get update && apt-get install -y linux-image-amd64");
}

static void machine(struct doctor *d)
{
    char vendor[128] = "", product[128] = "";
    char *text = doc_file(d->host, "/proc/cpuinfo"), *flags = malloc(4096);
    bool guest = text != NULL && flags != NULL && doc_parse_key(text, "flags", flags, 4096) &&
                 doc_has_word(flags, "hypervisor");
    free(text);
    free(flags);
    (void)doc_text(d->host, vendor, sizeof vendor, "/sys/class/dmi/id/sys_vendor");
    (void)doc_text(d->host, product, sizeof product, "/sys/class/dmi/id/product_name");
    if (doc_settled(!guest, d, DOC_OK, 32, "machine", "not a virtual machine"))
        return;
    struct doc_finding *f = doc_say(d, DOC_WARN, 32, "machine", "a virtual machine%s%s%s%s%s",
                                    vendor[0] != '\0' ? " (" : "", vendor,
                                    vendor[0] != '\0' && product[0] != '\0' ? ", " : "",
                                    vendor[0] != '\0' ? product : "", vendor[0] != '\0' ? ")" : "");
    doc_means(f, "it pauses whenever its host does something else: packets and frames are lost "
                 "and times vary, and nothing here shows it");
    doc_note(f, "for measurements use the machine itself; else pass the network card or USB "
                "controller through and give the guest processors of its own");
}

void doc_check_system(struct doctor *d)
{
    kernel(d);
    machine(d);
}
