"""How many lines a second a printer acknowledges where no motion holds them up.

    cargo run --release -- serve --pty /tmp/printer --speed max
    python3 tests/hosts/lines_a_second.py /tmp/printer 16
"""

import os
import sys
import time
import tty

LINES = 100_000


def numbered(number, text):
    line = f"N{number} {text}"
    checksum = 0
    for byte in line.encode():
        checksum ^= byte
    return f"{line}*{checksum}\n".encode()


def main():
    port, in_flight = sys.argv[1], int(sys.argv[2])
    terminal = os.open(port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(terminal)
    lines = [numbered(0, "M110 N0")] + [numbered(number, "G92 E0") for number in range(1, LINES)]
    began = time.monotonic()
    sent = acknowledged = 0
    rest = b""
    while acknowledged < LINES:
        while sent < LINES and sent - acknowledged < in_flight:
            os.write(terminal, lines[sent])
            sent += 1
        *heard, rest = (rest + os.read(terminal, 65536)).split(b"\n")
        acknowledged += sum(line.startswith(b"ok") for line in heard)
    print(f"{LINES / (time.monotonic() - began):.0f} lines a second, {in_flight} in flight")


main()
