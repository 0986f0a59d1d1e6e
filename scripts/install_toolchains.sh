#!/usr/bin/env bash
# Installs what the tests of other languages and of our pages need, where it is missing: Debian, as root.
# Without it `make test` skips those tests and says so.
set -euo pipefail

packages=()
command -v gcc >/dev/null && command -v make >/dev/null || packages+=(gcc make libc6-dev)
command -v node >/dev/null || packages+=(nodejs)
command -v octave >/dev/null || packages+=(octave)
command -v javac >/dev/null || packages+=(default-jdk-headless)
command -v cargo >/dev/null || packages+=(cargo)
command -v chromium >/dev/null || packages+=(chromium)

if [ ${#packages[@]} -gt 0 ]; then
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq
    apt-get install -y -qq --no-install-recommends "${packages[@]}" >/dev/null
fi
