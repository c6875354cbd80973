#!/bin/sh
# With ZMQ_IPV6, a ZeroMQ client of a name with two addresses tries the IPv6 address alone, for ever.
#
# Expected: a name that has an IPv6 and an IPv4 address leads to a server on either, as in browsers and in Python's
#           create_connection, at the latest when the client connects again.
# Happens:  a client of tcp://localhost that has ZMQ_IPV6 set never reaches a server on 127.0.0.1, however often it connects
#           again.  Without ZMQ_IPV6 it reaches it, and then no server on [::1].
# Seen in:  libzmq5 4.3.4-6, python3-zmq 24.0.1-4+b1 (Debian 12)
. "$(dirname "$0")/root.sh"
root libzmq5=4.3.4-6 python3-zmq=24.0.1-4+b1
mkdir -p "$R/etc"
printf '127.0.0.1 both\n::1 both\n' > "$R/etc/hosts"
echo 'multi on' > "$R/etc/host.conf"
echo 'hosts: files' > "$R/etc/nsswitch.conf"
cat > "$R/try/try.py" <<'PY'
import socket
import time
import zmq

context = zmq.Context()
print('libzmq', zmq.zmq_version())
print('the name has', ' and '.join(sorted({a[4][0] for a in socket.getaddrinfo('both', 80)})))
for option in (0, 1):
    for host in ('127.0.0.1', '[::1]'):
        server = context.socket(zmq.PUSH)
        server.IPV6, server.LINGER, server.SNDTIMEO = 1, 0, 5000
        port = server.bind_to_random_port('tcp://' + host)
        client = context.socket(zmq.PULL)
        client.IPV6, client.LINGER, client.RECONNECT_IVL = option, 0, 50
        client.connect('tcp://both:%d' % port)
        try:
            server.send(b'here')  # waits for a client
            said = 'reached'
        except zmq.Again:
            said = 'not reached in 5 s'
        print('client with ZMQ_IPV6 %d, server on %s: %s' % (option, host, said))
        client.close()
        server.close()
PY
ends "$(inside python3 try.py 2>&1)" 'libzmq 4.3.4
the name has 127.0.0.1 and ::1
client with ZMQ_IPV6 0, server on 127.0.0.1: reached
client with ZMQ_IPV6 0, server on [::1]: not reached in 5 s
client with ZMQ_IPV6 1, server on 127.0.0.1: not reached in 5 s
client with ZMQ_IPV6 1, server on [::1]: reached'
