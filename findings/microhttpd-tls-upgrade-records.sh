#!/bin/sh
# libmicrohttpd sends an upgraded TLS connection in records of four bytes.
#
# Expected: after "101 Switching Protocols" on a TLS daemon, what the application writes to the upgraded socket goes out in TLS
#           records about as large as the writes, up to 16 kB, as an ordinary response does.
# Happens:  with the default memory limit of a connection the records carry 4 bytes each.  1000 bytes take 250 records, each with
#           22 bytes around it, so a WebSocket is slow whatever the network is.
# Seen in:  libmicrohttpd-dev 0.9.75-6 with GnuTLS 3.7.9 (Debian 12)
. "$(dirname "$0")/root.sh"
root libmicrohttpd-dev=0.9.75-6 gcc=4:12.2.0-3 libc6-dev python3 openssl
cat > "$R/try/server.c" <<'C'
#include <microhttpd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>
static char bytes[1000];
static void upgraded(void *cls, struct MHD_Connection *c, void *con, const char *extra, size_t n, MHD_socket fd,
                     struct MHD_UpgradeResponseHandle *h)
{
    for (size_t at = 0; at < sizeof bytes;) {
        ssize_t k = send(fd, bytes + at, sizeof bytes - at, 0);
        if (k > 0)
            at += (size_t)k;
        else
            usleep(1000);
    }
}
static enum MHD_Result answer(void *cls, struct MHD_Connection *c, const char *url, const char *method, const char *version,
                              const char *up, size_t *n, void **con)
{
    struct MHD_Response *r;
    if (strcmp(url, "/upgrade") == 0) {
        r = MHD_create_response_for_upgrade(upgraded, NULL);
        MHD_add_response_header(r, "Upgrade", "raw");
        return MHD_queue_response(c, MHD_HTTP_SWITCHING_PROTOCOLS, r);
    }
    r = MHD_create_response_from_buffer(sizeof bytes, bytes, MHD_RESPMEM_PERSISTENT);
    return MHD_queue_response(c, MHD_HTTP_OK, r);
}
static char *file(const char *name)
{
    static char room[2][8192];
    static int n;
    FILE *f = fopen(name, "r");
    room[n][fread(room[n], 1, sizeof room[n] - 1, f)] = '\0';
    return room[n++];
}
int main(void)
{
    struct MHD_Daemon *d = MHD_start_daemon(
        MHD_USE_TLS | MHD_ALLOW_UPGRADE | MHD_USE_INTERNAL_POLLING_THREAD, 0, NULL, NULL, answer, NULL, MHD_OPTION_HTTPS_MEM_KEY,
        file("key.pem"), MHD_OPTION_HTTPS_MEM_CERT, file("cert.pem"), MHD_OPTION_END);
    if (d == NULL)
        return 1;
    printf("libmicrohttpd %s\n%d\n", MHD_get_version(), MHD_get_daemon_info(d, MHD_DAEMON_INFO_BIND_PORT)->port);
    fflush(stdout);
    getchar();
    return 0;
}
C
cat > "$R/try/try.py" <<'PY'
import socket
import ssl
import subprocess

server = subprocess.Popen('./server', stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
print(server.stdout.readline().strip())
port = int(server.stdout.readline())
for path, upgrade in (('/', ''), ('/upgrade', 'Connection: Upgrade\r\nUpgrade: raw\r\n')):
    tcp = socket.create_connection(('127.0.0.1', port))
    tcp.settimeout(60)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    context.maximum_version = ssl.TLSVersion.TLSv1_2  # application data has a record type of its own
    came, out = ssl.MemoryBIO(), ssl.MemoryBIO()
    tls = context.wrap_bio(came, out)
    stream, plain, asked = b'', b'', False
    while not plain.partition(b'\r\n\r\n')[2][999:]:
        try:
            if not asked:
                tls.do_handshake()
                tls.write(('GET %s HTTP/1.1\r\nHost: a\r\n%s\r\n' % (path, upgrade)).encode())
                asked = True
            plain += tls.read(65536)
        except ssl.SSLWantReadError:
            if out.pending:
                tcp.sendall(out.read())
            data = tcp.recv(65536)
            assert data, 'closed'
            stream += data
            came.write(data)
    records, at = 0, 0
    while at + 5 <= len(stream):
        records += stream[at] == 23
        at += 5 + int.from_bytes(stream[at + 3:at + 5], 'big')
    size = len(plain.partition(b'\r\n\r\n')[2])
    print('%s: %d bytes after the header in %s' % (path, size, '1 or 2 records' if records <= 2 else '%d records or more' % (records // 10 * 10)))
server.kill()
PY
inside gcc -w -o server server.c -lmicrohttpd || exit 2
inside openssl req -x509 -newkey rsa:2048 -nodes -keyout key.pem -out cert.pem -days 1 -subj /CN=a 2> /dev/null || exit 2
ends "$(inside python3 try.py 2>&1)" 'libmicrohttpd 0.9.75
/: 1000 bytes after the header in 1 or 2 records
/upgrade: 1000 bytes after the header in 250 records or more'
