#!/bin/sh
# Builds `recipes/` in shares with GNU parallel, on this machine. For several machines add
# `--sshloginfile FILE --workdir .`; the current folder and `shared` must then be on a file system of all.
#
#     sh parallel.sh [SHARES]
set -eu
shares=${1:-8}
seq "$shares" | parallel --halt never --joblog parallel.log \
    gs2e build recipes/ --keep-going --shard "{}/$shares" --store "stores/{}" --shared-store shared --jobs 1
