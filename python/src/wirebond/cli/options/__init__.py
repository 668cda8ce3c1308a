"""The options of every command, a module for each group of them. A command loads what it does when it is called."""
