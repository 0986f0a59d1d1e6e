#!/usr/bin/env bash
# asyncua: a Python int is an Int64 on the wire, so writing 5 to a variable of Doubles is refused; 5.0 is taken.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet asyncua==2.1.0
cat > "$folder/try.py" <<'PYTHON'
import asyncio
import logging

from asyncua import Client, Server, ua

logging.disable(logging.CRITICAL)
ADDRESS = "opc.tcp://127.0.0.1:48412"


async def main():
    server = Server()
    await server.init()
    server.set_endpoint(ADDRESS)
    speed = await server.nodes.objects.add_variable(await server.register_namespace("robot"), "speed", 1.5)
    await speed.set_writable()
    async with server, Client(ADDRESS) as client:
        for value in (5, 5.0):
            try:
                await client.get_node(speed.nodeid).write_value(value)
                print(value, "written")
            except ua.UaStatusCodeError as error:
                print(value, type(error).__name__)


asyncio.run(main())
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "asyncua 2.1.0: server and client, a variable with the value 1.5, write_value(5) and write_value(5.0)"
echo "guess: both are written"
echo "seen:  5 is BadTypeMismatch"
printf '5 BadTypeMismatch\n5.0 written\n' | cmp - "$folder/seen"
