#!/bin/sh
# A ZeroMQ REP socket drops the next client's reply after a foreign message from a peer that is gone.
#
# Expected: a message without an empty delimiter frame is not a request (ZMTP, REQ/REP pattern).  A REP ignores it, and the next
#           client gets its reply.
# Happens:  if the peer that sent it has gone, the REP receives the next request, takes the reply, and the reply reaches nobody.
#           That client waits for ever.  The one after it is served.
# Seen in:  libzmq5 4.3.4-6, python3-zmq 24.0.1-4+b1 (Debian 12)
. "$(dirname "$0")/root.sh"
root libzmq5=4.3.4-6 python3-zmq=24.0.1-4+b1
cat > "$R/try/try.py" <<'PY'
import time
import zmq

context = zmq.Context()
print('libzmq', zmq.zmq_version())
for foreign in (False, True):
    rep = context.socket(zmq.REP)
    rep.RCVTIMEO = 10000
    end = 'tcp://127.0.0.1:%d' % rep.bind_to_random_port('tcp://127.0.0.1')
    if foreign:
        d = context.socket(zmq.DEALER)
        d.connect(end)
        d.send(b'no delimiter before this')
        time.sleep(1)
        d.close()
        time.sleep(1)
    said = []
    for k in range(3):
        req = context.socket(zmq.REQ)
        req.RCVTIMEO, req.LINGER = 3000, 0
        req.connect(end)
        req.send(b'%d' % k)
        rep.send(b'reply to ' + rep.recv())
        try:
            said.append(req.recv().decode())
        except zmq.Again:
            said.append('no reply to %d' % k)
        req.close()
    rep.close()
    print('after a foreign message:' if foreign else 'alone:', ', '.join(said))
PY
ends "$(inside python3 try.py 2>&1)" 'libzmq 4.3.4
alone: reply to 0, reply to 1, reply to 2
after a foreign message: no reply to 0, reply to 1, reply to 2'
