"""Shared by a server and the programs that attach to it: its address, and the messages between them."""
