#!/usr/bin/env bash
# Reproductions of a hostile tester's findings, run with an old program and with the present one: each line names
# the finding and says `defect` or `sound` for both. The present program must be sound in all of them.
#
#     tests/hostile/before_after.sh OLD NEW
#
# OLD is the program of commit b476f4a, which the tester examined: `git worktree add ../before b476f4a`, then
# `cargo build` there. The tests in tests/it go further; this script shows that the findings were real.
# It needs GNU coreutils and python3, and takes about two minutes.
set -u
if [ $# != 2 ]; then
  sed -n '2,9s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
programs=("$(realpath "$1")" "$(realpath "$2")")
base=$(mktemp -d)
trap 'chmod -R u+w "$base"; rm -rf "$base"' EXIT

# A recipe that both programs read.
recipe() {
  cat <<'YAML'
version: 1
scene: t/tiny
source: { procedural: { kind: still-life, gaussians: 300, views: 4, arc: 6, seed: 1 } }
camera: { width: 64, height: 48 }
trajectories: [{ name: base, refine: { window: 2, factor: 3 }, speed: { function: "1" } }]
sensor: { voltmeter: { preset: dvs346 } }
outputs: [events, sharp]
licence: { expression: CC0-1.0, holder: Nobody }
YAML
}
# The program, ended after 20 seconds and at 2 GB of memory.
g() { (ulimit -v 2000000; timeout 20 "$program" "$@"); }
# Each test runs in an empty folder with the recipe, and succeeds if the defect is there.
stored_code() {
  recipe | sed 's/^outputs:/checks: { readback: {} }\noutputs:/' >r.yaml
  echo 'open("PWNED", "w").write("ran")' | tee json.py >numpy.py
  g plan . >/dev/null 2>&1
  [ -e PWNED ]
}
raw_escape() {
  { recipe | grep -v '^source\|^camera'
    printf 'source: { model: { path: "\\e[31mX" } }\nreconstruct: { given: { path: "\\e[31m\\e]0;PWN\\a.ply" } }\n'; } >r.yaml
  g plan r.yaml 2>&1 | grep -q "$(printf '\033\[31m')"
}
deleted_partial() {
  mkdir data.partial && echo thesis >data.partial/thesis.txt
  g release --to data r.yaml >/dev/null 2>&1
  ! [ -e data.partial/thesis.txt ]
}
deleted_data() {
  mkdir ds && echo precious >ds/thesis.txt && echo '{}' >ds/manifest.json
  (cd ds && sha256sum manifest.json thesis.txt >SHA256SUMS)
  g release --to ds r.yaml >/dev/null 2>&1
  ! [ -e ds/thesis.txt ]
}
dangling_takedown() {
  ln -s /nonexistent takedown.txt
  g release --to out r.yaml >/dev/null 2>&1
  [ -e out/manifest.json ]
}
useless_takedown() {
  echo '/t/tiny 2025-06-01' >takedown.txt
  g release --to out r.yaml >said 2>&1
  [ -e out/manifest.json ] && ! grep -q takedown said
}
no_events() {
  recipe | sed 's/preset: dvs346/preset: dvs346, threshold: { on: 1000, off: 1000 }/' >r.yaml
  g release --to out r.yaml >said 2>&1
  [ -e out/manifest.json ] && ! grep -qi 'no events' said
}
full_console() { g plan --json r.yaml >/dev/full 2>/dev/null; }
panic_on_bytes() {
  local store
  store=$(printf 'x\377')/.gs2e
  mkdir "$(dirname "$store")"
  g build --store "$store" r.yaml >/dev/null 2>&1
  g plan --json --store "$PWD/$store" r.yaml >/dev/null 2>&1
  [ $? = 101 ]
}
endless_pipe() {
  { recipe | grep -v '^source\|^camera'
    printf 'source: { model: { path: cameras.json } }\nreconstruct: { given: { path: x.ply } }\n'; } >r.yaml
  mkfifo cameras.json
  g plan r.yaml >/dev/null 2>&1
  [ $? = 124 ]
}
endless_recipe() {
  ln -s /dev/zero z.yaml
  g plan z.yaml 2>&1 >/dev/null | grep -q 'out of memory'
}
all_pixels_hot() {
  recipe | sed 's/preset: dvs346/preset: dvs346, hot_pixels: { share: 1, rate: 1e6 }/' >r.yaml
  g plan r.yaml >/dev/null 2>&1
}
many_threads() {
  # Without the limit of memory: 4096 stacks take addresses only.
  timeout 20 "$program" build -j4096 r.yaml >/dev/null 2>&1
  [ $? = 124 ]
}
# The control: without a fault, a release is written.
control() { ! g release --to out r.yaml >said 2>&1; }

tests='control stored_code raw_escape deleted_partial deleted_data dangling_takedown useless_takedown no_events
full_console panic_on_bytes endless_pipe endless_recipe all_pixels_hot many_threads'
defects=0
printf '%-20s %-8s %s\n' finding before now
for name in $tests; do
  line=$(printf '%-20s' "$name")
  for i in 0 1; do
    program=${programs[$i]}
    mkdir "$base/$name.$i"
    cd "$base/$name.$i" || exit 1
    recipe >r.yaml
    found=sound
    if "$name"; then found=defect; fi
    line+=$(printf ' %-8s' "$found")
    if [ "$i$found" = 1defect ]; then defects=$((defects + 1)); fi
  done
  printf '%s\n' "$line"
done
exit $((defects > 0))
