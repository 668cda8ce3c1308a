#!/usr/bin/env bash
# Make sure that system packages are there: installs them where the user is root, else prints the exact command.
# Usage: setup/system-packages.sh WHAT=PACKAGE…   (WHAT: a command, or a file that the package brings)
set -euo pipefail

missing=()
for pair in "$@"; do
  what=${pair%%=*}
  package=${pair#*=}
  if [[ $what == /* ]]; then [[ -e $what ]] || missing+=("$package")
  else command -v "$what" >/dev/null 2>&1 || missing+=("$package"); fi
done
[[ ${#missing[@]} -eq 0 ]] && exit 0

# ser2net comes with a service that would listen on TCP ports 2000, 2001, 3000 and 3001 of this machine alone, and open
# /dev/ttyS0 and ttyS1 for who connects. Tests run a ser2net of their own.
quiet=""
if [[ " ${missing[*]} " == *" ser2net "* && -d /run/systemd/system ]]; then quiet="systemctl disable --now --quiet ser2net"; fi

install="apt-get install -y --no-install-recommends ${missing[*]}"
if ! command -v apt-get >/dev/null 2>&1; then
  echo "Missing: ${missing[*]} (names of Debian packages). Install them with your system's package manager and run this again." >&2
  exit 1
fi
if [[ $(id -u) -ne 0 ]]; then
  echo "Missing system packages. Install them with" >&2
  echo "    sudo apt-get update && sudo $install${quiet:+ && sudo $quiet}" >&2
  echo "and run this again." >&2
  exit 1
fi
echo "Installing system packages: ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
if ! { apt-get update && $install && $quiet; } >"$log" 2>&1; then
  tail -n 20 "$log" >&2
  echo "Could not install ${missing[*]}; the lines above are the package manager's." >&2
  exit 1
fi
rm -f "$log"
