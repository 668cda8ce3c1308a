"""What a server and the programs that attach to it have in common: its address, and the words that they exchange."""
