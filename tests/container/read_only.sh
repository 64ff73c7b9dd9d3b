#!/bin/sh
# Builds and audits a release as a container with a read-only root does: `podman run --read-only --user 12345`, without
# an engine.
#
#     read_only.sh PROGRAM RECIPE
#
# The root has /usr, /proc and four devices. There is no /etc/passwd, no HOME and no writable /tmp, and the user 12345 has
# no name. Only /work is writable, and empty. Exits with 77 where the kernel lends no user namespace.
set -eu

# In the namespace: assembles the root, and starts the rest of the script in it.
assemble() {
    root=$1 work=$2 program=$3 recipe=$4
    mount --make-rprivate /
    mount -t tmpfs -o mode=755 none "$root"
    cd "$root"
    mkdir usr proc dev tmp work opt
    mount --rbind /usr usr
    mount --rbind /proc proc
    mount --bind "$work" work
    for name in bin sbin lib lib64; do
        if [ -L "/$name" ]; then
            cp -P "/$name" "$name"
        elif [ -d "/$name" ]; then
            mkdir "$name"
            mount --rbind "/$name" "$name"
            mount -o remount,bind,ro "$name"
        fi
    done
    for device in null zero full urandom; do
        touch "dev/$device"
        mount --bind "/dev/$device" "dev/$device"
    done
    touch opt/gs2e opt/recipe.yaml
    mount --bind "$program" opt/gs2e
    mount --bind "$recipe" opt/recipe.yaml
    for place in usr opt/gs2e opt/recipe.yaml .; do
        mount -o remount,bind,ro "$place"
    done
    # As in a container, the program has no capability.
    exec chroot "$root" /usr/bin/setpriv --inh-caps=-all --ambient-caps=-all --bounding-set=-all \
        /usr/bin/env -i PATH=/usr/bin sh -euc "$inside"
}

# In the root: first that it is what it should be.
inside='
cd /work
[ "$(id -u)" = 12345 ]
if id -un 2>/dev/null; then echo "the user has a name" >&2; exit 1; fi
for place in / /tmp /opt /usr /usr/bin; do
    if touch "$place/written" 2>/dev/null; then echo "$place is writable" >&2; exit 1; fi
done
[ -z "${HOME-}" ]
/opt/gs2e --version
/opt/gs2e --backend cpu release --to out /opt/recipe.yaml
/opt/gs2e audit out
/opt/gs2e --backend cpu release --to out /opt/recipe.yaml 2>&1 | grep "^0 steps built,"
'

if [ "${1-}" = --assemble ]; then
    shift
    assemble "$@"
fi
[ $# = 2 ] || { echo "usage: $0 PROGRAM RECIPE" >&2; exit 2; }
alone="unshare --user --map-user=12345 --map-group=12345 --mount --keep-caps"
if ! $alone mount -t tmpfs none /mnt 2>/dev/null; then
    echo "absent: user namespaces" >&2
    exit 77
fi
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
mkdir "$place/root" "$place/work"
$alone "$0" --assemble "$place/root" "$place/work" "$(realpath "$1")" "$(realpath "$2")"
