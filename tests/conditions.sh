#!/bin/sh
# Runs a command, such as the binary of the tests, under a condition of another machine:
#
#     cargo test --test it --no-run          # prints the path of the binary
#     tests/conditions.sh CONDITION target/debug/deps/it-… [ARGUMENTS]
#
# CONDITION: `busy`, four other processes that never rest; `one-core`; `small`, 2 GB of memory; `user`, a user without
# rights and without a home; `bare`, a PATH without an optional program. Exits with 77 where the machine cannot do it.
set -eu

condition=$1
shift
place=$(mktemp -d)
group=
others=
finish() {
    for other in $others; do kill "$other" 2> /dev/null || true; done
    [ -z "$group" ] || rmdir "$group"
    rm -rf "$place"
}
trap finish EXIT
lacking() {
    echo "conditions.sh: $1" >&2
    exit 77
}

case $condition in
busy)
    for _ in 1 2 3 4; do
        (while :; do :; done) &
        others="$others $!"
    done
    "$@"
    ;;
one-core)
    taskset -c 0 "$@"
    ;;
small)
    # Control groups of version 2, or of version 1.
    root=/sys/fs/cgroup limit=memory.max
    [ -f "$root/cgroup.controllers" ] || root=/sys/fs/cgroup/memory limit=memory.limit_in_bytes
    [ -f "$root/cgroup.procs" ] && mkdir "$root/gs2e.$$" || lacking "a control group cannot be made"
    group=$root/gs2e.$$
    echo 2G > "$group/$limit" || lacking "the memory of a control group cannot be limited"
    sh -c 'echo $$ > "$0/cgroup.procs" && exec "$@"' "$group" "$@"
    ;;
user)
    # The user must be able to read the repository and the binary.
    chmod 777 "$place"
    as="setpriv --reuid=65534 --regid=65534 --clear-groups --inh-caps=-all env -u HOME TMPDIR=$place"
    $as test -x "$(command -v "$1")" || lacking "the user 65534 cannot run $1"
    $as "$@"
    ;;
bare)
    # What every Unix has; the shell of a cluster task takes `mktemp`, and training programs of the tests `dirname`.
    for program in sh bash env ls cat cp mv rm ln mkdir mkfifo mktemp chmod du cut dirname sed grep head sleep seq true kill \
        touch setsid unshare mount sha256sum; do
        found=$(command -v "$program") && ln -s "$found" "$place/$program"
    done
    PATH=$place "$@"
    ;;
*)
    sed -n '2,8p' "$0" >&2
    exit 2
    ;;
esac
