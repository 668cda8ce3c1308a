"""Write files from a protocol, or a protocol file from other sources. Uses protocols and their analysis."""
