"""The far end of a wire, as a process: takes bytes off a pty's controller a byte time each, never faster.

    far_end.py DESCRIPTOR BYTES_PER_SECOND DATA TIMES

DATA gets the bytes, TIMES a line "monotonic-time total" for each read.
"""

import os
import select
import sys
import time

descriptor, rate = int(sys.argv[1]), float(sys.argv[2])
data = os.open(sys.argv[3], os.O_WRONLY | os.O_CREAT)
times = os.open(sys.argv[4], os.O_WRONLY | os.O_CREAT)
os.write(1, b"ready\n")
total, parent = 0, os.getppid()
last = time.monotonic()
while os.getppid() == parent:
    if not select.select([descriptor], [], [], 0)[0]:
        select.select([descriptor], [], [], 0.5)
        last = time.monotonic()  # a wire that carries nothing saves no time up
        continue
    now = time.monotonic()
    credit = int((now - last) * rate)
    if credit == 0:
        time.sleep(0.0003)
        continue
    try:
        got = os.read(descriptor, credit)
    except OSError:  # nobody has the tty open
        time.sleep(0.005)
        continue
    total += len(got)
    last += len(got) / rate
    os.write(data, got)
    os.write(times, f"{now} {total}\n".encode())
