"""A program that attaches to a server and drives, until it is ended from outside: `writer.py ADDRESS send|repeat`."""

import sys
import time

import wirebond

address, how = sys.argv[1:]
with wirebond.open(address) as link:
    said = False
    while True:
        try:
            if how == "send":
                link.send("velocity", linear=1.0, angular=0.0)
            else:
                link.repeat("velocity", linear=1.0, angular=0.0, hold=60)
            if not said:
                print("drives", flush=True)
                said = True
        except wirebond.WirebondError as error:
            print(type(error).__name__, flush=True)
        time.sleep(0.02)
