"""A MINAS A6 drive and a client of one, both over pymodbus. `serve rtu|tcp` prints its port and answers as a drive does whose block
operation is set up; `ask rtu|tcp PORT` moves a drive there and back and prints what it saw as one line of JSON."""
import asyncio
import json
import socket
import sys
import time

from pymodbus.client import ModbusTcpClient
from pymodbus.framer import FramerType
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

FRAMERS = {"rtu": FramerType.RTU, "tcp": FramerType.SOCKET}
SERVO, STROBE, S_STOP, BUSY, OUTPUTS = 0x60, 0x120, 0x124, 0x140, 0xA0
UNITS_PER_TURN, GEAR = 1_600_000, 40


def low_first(value):
    value &= 0xFFFFFFFF
    return [value & 0xFFFF, value >> 16]


def signed(low, high):
    value = high << 16 | low
    return value - (1 << 32) if value >= 1 << 31 else value


class Drive:
    """Moves evenly, without ramps: a block behaves, its profile does not."""

    def __init__(self):
        self.start = self.end = 0.0
        self.began = self.takes = 0.0
        self.words = {0x3000 + 0x600 + 2 * 28: 1, 0x4D02: 0x0000, 0x4D03: 0x0080}
        for index, word in enumerate([0x414D, 0x4C44, 0x3154, 0x5335, 0x0046]):
            self.words[0x1000 + index] = word
        self.on = set()

    def position(self):
        share = min(1.0, (time.monotonic() - self.began) / self.takes) if self.takes else 1.0
        return self.start + share * (self.end - self.start)

    def is_busy(self):
        return time.monotonic() < self.began + self.takes

    def run(self):
        if S_STOP in self.on or SERVO not in self.on or self.words.get(0x4300) != 0x55:
            return
        block = 0x4800 + 4 * self.words.get(0x4414, 0)
        command, data = (signed(self.words.get(at, 0), self.words.get(at + 1, 0)) for at in (block, block + 2))
        code, speed = command >> 24 & 0xFF, command >> 20 & 0xF
        r_per_min, ramp = self.words.get(0x4600 + speed, 0), self.words.get(0x4610 + (command >> 16 & 0xF), 0)
        if code not in (1, 2) or command & 0x0F or not r_per_min or not ramp:
            self.words[0x4001] = 0x5D01
            return
        self.start = self.position()
        self.end = self.start + data if code == 1 else data
        self.began = time.monotonic()
        self.takes = abs(self.end - self.start) / (r_per_min / 60 * UNITS_PER_TURN / GEAR)

    def write_coil(self, coil, on):
        rises = on and coil not in self.on
        (self.on.add if on else self.on.discard)(coil)
        if coil == STROBE and rises:
            self.run()
        if coil == S_STOP and on and self.is_busy():
            self.start = self.end = self.position()
            self.takes = 0.0

    def coil(self, coil):
        return {
            BUSY: self.is_busy(),
            OUTPUTS: True,
            OUTPUTS + 2: not self.is_busy(),
            OUTPUTS + 3: SERVO in self.on,
            OUTPUTS + 15: SERVO not in self.on,
        }.get(coil, coil in self.on)

    def word(self, register):
        if 0x600B <= register <= 0x6010:
            return low_first(round(self.position()))[(register - 0x600B) % 2]
        return self.words.get(register, 0)

    async def act(self, function, start, address, count, registers, values):
        if function in (1, 5, 15):
            # The registers hold sixteen coils each; the request says how many were written.
            if values is not None:
                for index, on in enumerate(values):
                    self.write_coil(address + index, on)
            first = address // 16
            for word in range(first, first + count):
                registers[word - start] = sum(self.coil(16 * word + bit) << bit for bit in range(16))
            return None
        for index in range(count):
            if values is not None:
                self.words[address + index] = values[index]
            registers[address + index - start] = self.word(address + index)
        return None


async def serve(framer):
    free = socket.socket()
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
    free.close()
    drive = Drive()
    registers = [SimData(0x1000, count=0x6000, values=0, datatype=DataType.REGISTERS)]
    bits = [SimData(0, count=64, values=0, datatype=DataType.BITS)]
    coils = [SimData(0, count=64, values=0, datatype=DataType.BITS)]
    device = SimDevice(id=1, simdata=(coils, bits, registers, registers), action=drive.act)
    server = ModbusTcpServer(device, framer=framer, address=("127.0.0.1", port))
    print(port, flush=True)
    await server.serve_forever()


def ask(framer, port):
    drive = ModbusTcpClient("127.0.0.1", port=port, framer=framer, timeout=2, retries=0)
    assert drive.connect()

    def good(reply):
        assert not reply.isError(), reply
        return reply

    def registers(address, count):
        return good(drive.read_holding_registers(address, count=count, device_id=1)).registers

    def position():
        return signed(*registers(0x600F, 2))

    def coil(address):
        return good(drive.read_coils(address, count=1, device_id=1)).bits[0]

    def switch(address, on):
        good(drive.write_coil(address, on, device_id=1))

    def move(units):
        good(drive.write_register(0x4600, 2000, device_id=1))
        good(drive.write_registers(0x4610, [100], device_id=1))
        good(drive.write_registers(0x4620, [100], device_id=1))
        good(drive.write_registers(0x4800, low_first(0x02000000) + low_first(units), device_id=1))
        good(drive.write_register(0x4414, 0, device_id=1))
        switch(STROBE, True)
        was_busy = coil(BUSY)
        while coil(BUSY):
            time.sleep(0.002)
        switch(STROBE, False)
        return was_busy and coil(OUTPUTS + 2)

    seen = {"model": "".join(chr(w & 255) + chr(w >> 8) for w in registers(0x1000, 8)).strip("\0")}
    seen["resolution"] = signed(*registers(0x4D02, 2))
    good(drive.write_register(0x4300, 0x55, device_id=1))
    switch(SERVO, True)
    time.sleep(0.2)
    seen["moved"] = [[move(units), position()] for units in (160_000, -1234)]
    good(drive.write_coils(S_STOP, [True], device_id=1))
    switch(STROBE, True)
    time.sleep(0.1)
    seen["held"] = [coil(BUSY), position()]
    switch(STROBE, False)
    switch(S_STOP, False)
    seen["error"] = registers(0x4001, 1)[0]
    reply = drive.read_holding_registers(0x0001, count=1, device_id=1)
    seen["exception"] = reply.exception_code if reply.isError() else None
    print(json.dumps(seen))


if __name__ == "__main__":
    if sys.argv[1] == "serve":
        asyncio.run(serve(FRAMERS[sys.argv[2]]))
    else:
        ask(FRAMERS[sys.argv[2]], int(sys.argv[3]))
