"""Other ways to move the same messages, each behind one interface, for benchmarks by equal rules (bench/README.md)."""
