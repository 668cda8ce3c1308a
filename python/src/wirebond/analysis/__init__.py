"""Judge protocols and bytes: lint, explain, compare, identify, diagnose. Uses protocols, the codec and links."""
