#!/bin/sh
# Fetch a version of uPlot from npm and put its files and their checksums here.
set -eu
version=${1:?usage: renew.sh VERSION, such as 1.6.32}
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm pack --silent "uplot@$version" >/dev/null
tar -xzf "uplot-$version.tgz"
cp package/LICENSE package/dist/uPlot.iife.min.js package/dist/uPlot.min.css "$here/uplot/"
cd "$here/uplot"
sha256sum LICENSE uPlot.iife.min.js uPlot.min.css >SHA256SUMS
cat SHA256SUMS
