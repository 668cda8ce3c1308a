"""Figures of Wirebond, measured by equal rules; `make bench` prints them and writes bench/latest.json."""
