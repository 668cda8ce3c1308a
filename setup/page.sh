#!/usr/bin/env bash
# The console's page, built into the Python package, where Node 20.19 or newer is there. Without it everything else works,
# and `wirebond serve --web` says that the page is missing. Prints one sentence; exits with 3 where there is no Node.
# Usage: setup/page.sh packages | build
set -euo pipefail
cd "$(dirname "$0")/../console"

if ! node -e 'const [a, b] = process.versions.node.split(".").map(Number); process.exit(a > 20 || (a === 20 && b >= 19) ? 0 : 1)' 2>/dev/null; then
  echo "The console's page is not built: that needs Node 20.19 or newer (https://nodejs.org). All else works without it." >&2
  exit 3
fi
case ${1:-} in
  packages)
    echo "Installing the page's packages into console/node_modules"
    npm ci --silent --no-fund --no-audit
    ;;
  build)
    echo "Building the console's page"
    npx --no-install vite build --logLevel warn
    ;;
  *)
    echo "usage: setup/page.sh packages | build" >&2
    exit 2
    ;;
esac
