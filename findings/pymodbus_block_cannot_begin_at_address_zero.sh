#!/usr/bin/env bash
# pymodbus: a data block of a server counts its registers from 1, the client's read_holding_registers
# from 0. A block at address 0 is refused, with a sentence that allows 0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pymodbus==3.16.1
"$folder/venv/bin/python" - 2>/dev/null <<'PYTHON'
import asyncio
import sys

import pymodbus
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.server import ModbusTcpServer

VALUES = [10, 11, 12, 13]


async def first_register(address):
    """Return what a client reads at address 0 of a server whose block begins at `address`."""
    block = ModbusSequentialDataBlock(address, VALUES)
    context = ModbusServerContext(devices=ModbusDeviceContext(hr=block), single=True)
    server = ModbusTcpServer(context, address=("127.0.0.1", 0))
    await server.listen()
    port = server.transport.sockets[0].getsockname()[1]
    client = AsyncModbusTcpClient("127.0.0.1", port=port)
    await client.connect()
    answer = await client.read_holding_registers(0, count=1)
    client.close()
    await server.shutdown()
    return answer.registers or str(answer)


try:
    ModbusSequentialDataBlock(0, VALUES)
    at_zero = "made"
except TypeError as exc:
    at_zero = f"TypeError: {exc}"
at_one = asyncio.run(first_register(1))
print(f"pymodbus {pymodbus.__version__}")
print("guess: a block at address 0 holds the registers that a client reads at 0")
print(f"seen: a block at 0: {at_zero}")
print(f"seen: a client reads at 0 of a block at 1: {at_one}")
sys.exit((at_zero, at_one) != ("TypeError: 0 <= address < 65535", [10]))
PYTHON
