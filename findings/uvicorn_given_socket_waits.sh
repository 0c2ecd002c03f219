#!/usr/bin/env bash
# Guess: a server that is handed a listening socket of `socket.create_server` answers as fast as one that opens its own.
# Seen (uvicorn 0.54.0 with h11 0.16.0, Python 3.11, Linux): not on one kept connection. asyncio switches Nagle's
# delay off only for sockets whose protocol number says TCP; create_server leaves it 0, and accepted connections inherit
# that. uvicorn sends header and body apart, so each answer after the first waits some 40 ms for the client's
# acknowledgement: 25 frames a second at best for a film in a browser. Setting TCP_NODELAY on the listening socket mends it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q uvicorn==0.54.0 h11==0.16.0
cat > "$folder/wait.py" <<'PY'
import http.client
import socket
import statistics
import threading
import time

import uvicorn


async def app(scope, receive, send):
    body = b"x" * 500
    head = [(b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": 200, "headers": head})
    await send({"type": "http.response.body", "body": body})


def answer_ms(listening: socket.socket) -> float:
    server = uvicorn.Server(uvicorn.Config(app, http="h11", loop="asyncio", lifespan="off", log_level="error"))
    threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True).start()
    while not server.started:
        time.sleep(0.01)
    client = http.client.HTTPConnection("127.0.0.1", listening.getsockname()[1])
    took = []
    for _ in range(40):
        began = time.perf_counter()
        client.request("GET", "/")
        client.getresponse().read()
        took.append(1e3 * (time.perf_counter() - began))
    server.should_exit = True
    return statistics.median(took[10:])


plain = socket.create_server(("127.0.0.1", 0))
mended = socket.create_server(("127.0.0.1", 0))
mended.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
tcp = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
tcp.bind(("127.0.0.1", 0))
tcp.listen()
a, b, c = answer_ms(plain), answer_ms(mended), answer_ms(tcp)
print(f"ms an answer on one connection: create_server {a:.1f}, with TCP_NODELAY {b:.1f}, socket(..., IPPROTO_TCP) {c:.1f}")
assert a > 30.0 and b < 20.0 and c < 20.0
PY
"$folder/venv/bin/python" "$folder/wait.py"
