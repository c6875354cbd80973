/* test_aravis_end.c - a camera is let go while Aravis still holds it: its last reference is dropped by a
 * thread of ours, or the finalizer would join the thread that it runs in, and GLib would end the process. */
#include <arpa/inet.h>
#include <arv.h>
#include <semaphore.h>
#include <sys/socket.h>

#include "capture/wire/be.h"
#include "capture/wire/gvcp.h"
#include "tests/lib/arvbed.h"
#include "tests/lib/logged.h"

static sem_t entered, release;
static bool listened;

/* In Aravis' heartbeat thread, within the emission, which holds a reference of the device. */
static gboolean hold_open(GSignalInvocationHint *hint, guint n, const GValue *value, gpointer user)
{
    (void)n;
    (void)user;
    listened |= g_signal_has_handler_pending(g_value_get_object(value), hint->signal_id, 0, TRUE);
    sem_post(&entered);
    sem_wait(&release);
    return TRUE;
}

static guint control_lost(void)
{
    g_type_class_ref(ARV_TYPE_DEVICE);
    return g_signal_lookup("control-lost", ARV_TYPE_DEVICE);
}

/* With G_DEBUG=fatal-criticals a slip of a library would end the daemon.  The first to open a camera. */
T_CASE(a_critical_is_a_line_of_the_log)
{
    bed_all(20);
    g_log_set_always_fatal((GLogLevelFlags)(G_LOG_LEVEL_CRITICAL | G_LOG_LEVEL_WARNING));
    struct cap_source_config c = bed_source(0);
    struct session s;
    log_begin(PVX_LOG_WARN);
    if (begin(&s, &c))
        g_object_ref(NULL);
    end(&s);
    log_end();
    T_EQ_I(log_count("GLib-GObject: g_object_ref: assertion"), 1);
}

/* A camera after a restart is nobody's: the heartbeat says so while we let it go. */
T_CASE(the_emission_outlives_the_source)
{
    bed_all(20);
    gulong hook = g_signal_add_emission_hook(control_lost(), 0, hold_open, NULL, NULL);
    struct cap_source_config c = bed_source(0), again = bed_source(0);
    struct session s;
    if (!begin(&s, &c))
        return;
    bed_fresh(0);
    sem_wait(&entered);
    end(&s);
    sem_post(&release);
    g_signal_remove_emission_hook(control_lost(), hook);
    T_OK(!listened);         /* nor does anybody listen who would make every emission hold one */
    if (begin(&s, &again)) { /* as soon as it was given up, it is there for the next */
        struct cap_frame *f = next_frame(&s.box);
        T_OK(f != NULL);
        if (f != NULL)
            cap_frame_release(f);
    }
    end(&s);
}

/* The loss is told although nobody listens to Aravis' signal. */
T_CASE(control_lost_is_told)
{
    bed_all(20);
    struct cap_source_config c = bed_source(0);
    struct session s;
    if (!begin(&s, &c))
        return;
    bed_fresh(0);
    pthread_mutex_lock(&s.box.lock);
    while (s.box.lost == 0)
        pthread_cond_wait(&s.box.change, &s.box.lock);
    pthread_mutex_unlock(&s.box.lock);
    end(&s);
    T_EQ_I(s.box.lost, 1);
}

/* ---- a camera whose memory is garbage ----------------------------------------------------------- */

#define LIAR "127.0.0.9"

#define XML_AT 0x10000

static struct {
    int fd;
    char url[64];
    const char *xml;
    pthread_t thread;
} liar;

/* Bytes of its memory: the address of the GenICam file, that file, else 0. */
static void lie_memory(uint32_t at, uint8_t *out, size_t n)
{
    const char *from = at == 0x200 ? liar.url : at >= XML_AT ? liar.xml : "";
    size_t skip = at >= XML_AT ? at - XML_AT : 0, len = strlen(from);
    if (skip < len)
        memcpy(out, from + skip, len - skip < n ? len - skip : n);
}

/* Answers whatever it is asked, until it gets a datagram of one byte. */
static void *lie(void *unused)
{
    (void)unused;
    for (;;) {
        uint8_t p[CAP_GVCP_MAX], data[CAP_GVCP_MAX] = {0};
        struct sockaddr_in from;
        socklen_t len = sizeof from;
        ssize_t n = recvfrom(liar.fd, p, sizeof p, 0, (struct sockaddr *)&from, &len);
        if (n < CAP_GVCP_HEAD)
            return NULL;
        uint16_t command = cap_get16(p + 2);
        size_t size = 4;
        if (command == CAP_GVCP_DISCOVERY)
            size = CAP_GVCP_DISCOVER;
        if (command == CAP_GVCP_READMEM) {
            size = 4 + cap_get16(p + CAP_GVCP_HEAD + 6);
            memcpy(data, p + CAP_GVCP_HEAD, 4);
            lie_memory(cap_get32(p + CAP_GVCP_HEAD), data + 4, size - 4);
        }
        cap_put16(p, CAP_GVCP_OK);
        cap_put16(p + 2, (uint16_t)(command + 1));
        cap_put16(p + 4, (uint16_t)size);
        memcpy(p + CAP_GVCP_HEAD, data, size);
        sendto(liar.fd, p, CAP_GVCP_HEAD + size, 0, (struct sockaddr *)&from, len);
    }
}

/* The camera is refused as corrupt, with this text. */
static void lie_refused(size_t announced, const char *xml, const char *text)
{
    struct sockaddr_in sa = {.sin_family = AF_INET, .sin_port = htons(CAP_GVCP_PORT)};
    inet_pton(AF_INET, LIAR, &sa.sin_addr);
    liar.fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    liar.xml = xml;
    snprintf(liar.url, sizeof liar.url, "Local:liar.xml;%x;%zx", XML_AT, announced);
    T_EQ_I(bind(liar.fd, (struct sockaddr *)&sa, sizeof sa), 0);
    T_EQ_I(pthread_create(&liar.thread, NULL, lie, NULL), 0);
    struct cap_source_config c = bed_source(0);
    c.uri = LIAR;
    cap_source *src = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(ops->open(&c, &src, &d), PVX_ECORRUPT);
    T_CONTAINS(d.text, "camera a (aravis:" LIAR ")");
    T_CONTAINS(d.text, text);
    T_EQ_I(sendto(liar.fd, "", 1, 0, (struct sockaddr *)&sa, sizeof sa), 1);
    pthread_join(liar.thread, NULL);
    close(liar.fd);
}

T_CASE(an_absurd_genicam_file_is_not_asked_for)
{
    lie_refused(SIZE_MAX / 2, "", "announces a GenICam file of more than 64 MiB");
}

/* Nodes; setting the pixel format, which comes first, asks for "Width". */
#define XML(nodes)                                                                               \
    "<RegisterDescription ModelName=\"L\" VendorName=\"L\" SchemaMajorVersion=\"1\" "            \
    "SchemaMinorVersion=\"1\" xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">"              \
    "<Group><Enumeration Name=\"PixelFormat\"><EnumEntry Name=\"Mono8\"><Value>17301505</Value>" \
    "</EnumEntry><pValue>Width</pValue></Enumeration>" nodes                                     \
    "</Group><Port Name=\"Device\"/></RegisterDescription>"

T_CASE(a_genicam_file_that_refers_to_itself_is_refused)
{
    static const char *const xml[] = {
        XML("<Integer Name=\"Width\"><pValue>Width</pValue></Integer>"),
        XML("<Integer Name=\"Width\"><pValue>B</pValue></Integer>"
            "<IntSwissKnife Name=\"B\"><pVariable Name=\"X\">C</pVariable>"
            "<Formula>X+1</Formula></IntSwissKnife>"
            "<IntReg Name=\"C\"><pAddress>Width</pAddress><Length>4</Length>"
            "<pPort>Device</pPort></IntReg>"),
        XML("<IntReg Name=\"Width\"><Address>0</Address><pIndex pOffset=\"Width\">Z</pIndex>"
            "<Length>4</Length><pPort>Device</pPort></IntReg>"
            "<Integer Name=\"Z\"><Value>1</Value></Integer>"),
        XML("<StructReg><pAddress>Width</pAddress><Length>4</Length><pPort>Device</pPort>"
            "<StructEntry Name=\"Width\"><LSB>31</LSB><MSB>0</MSB></StructEntry></StructReg>"),
    };
    for (size_t i = 0; i < sizeof xml / sizeof xml[0]; i++)
        lie_refused(strlen(xml[i]), xml[i], "of its GenICam file refers to itself");
}

/* Too deep for the stack, if not endless. */
T_CASE(a_genicam_file_of_many_levels_is_refused)
{
    enum { N = 20000 };
    size_t n;
    char *xml;
    FILE *f = open_memstream(&xml, &n);
    fputs("<RegisterDescription ModelName=\"L\" VendorName=\"L\">"
          "<Integer Name=\"Width\"><pValue>N0</pValue></Integer>",
          f);
    for (int i = 0; i < N; i++)
        fprintf(f, "<Integer Name=\"N%d\"><pValue>N%d</pValue></Integer>", i, i + 1);
    fprintf(f, "<Integer Name=\"N%d\"><Value>1</Value></Integer></RegisterDescription>", N);
    fclose(f);
    lie_refused(n, xml, "a chain of more than 200 nodes");
    free(xml);
}

static void set_up(void)
{
    sem_init(&entered, 0, 0);
    sem_init(&release, 0, 0);
    bed_open();
}
T_MAIN(set_up(), bed_close())
