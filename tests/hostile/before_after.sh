#!/usr/bin/env bash
# Reproductions of a hostile tester's findings, run with an old program and with the present one: each line names
# the finding and says `defect` or `sound` for both. The present program must be sound in all of them.
#
#     tests/hostile/before_after.sh OLD NEW [TEST…]
#
# OLD is the program of commit b476f4a, which the tester examined (add56fde for the groups folders, shared, bounds,
# products and audit): `git worktree add ../before b476f4a`, then `cargo build` there. The tests in tests/it go
# further; this script shows that the findings were real. A third verdict, `unclear`, means that neither was seen;
# what the program said is then on stderr.
# It needs Linux, GNU coreutils and Python 3, and takes some minutes.
set -u
if [ $# -lt 2 ]; then
  sed -n '2,11s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
programs=("$(realpath "$1")" "$(realpath "$2")")
shift 2
here=$(dirname "$(realpath "$0")")
base=$(mktemp -d)
# Ends what a test may have left, and removes its files.
clean() {
  trap - EXIT INT TERM
  # shellcheck disable=SC2046
  kill $(jobs -p) $(cat "$base"/*/left.pid 2>/dev/null) 2>/dev/null
  wait
  chmod -R u+rwX "$base" 2>/dev/null
  rm -rf "$base"
}
trap clean EXIT
trap 'exit 130' INT TERM
# No GPU: the same on every machine.
export VK_DRIVER_FILES=/nonexistent VK_ICD_FILENAMES=/nonexistent

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
# The recipe with another source, and with these Gaussians: `sourced SOURCE PATH`.
sourced() {
  recipe | grep -v '^source\|^camera'
  printf 'source: { %s }\nreconstruct: { given: { path: "%s" } }\n' "$1" "$2"
}
# Runs the program, with at most 60 seconds and 2 GB of addresses. Its exit code is then in $code, and what it
# said in the files `stdout` and `stderr`. `seconds=5 g …` gives it less time; 124 is the code if that is over.
g() {
  (ulimit -v 2000000; exec timeout -k 1 "${seconds:-60}" "$program" "$@") >stdout 2>stderr </dev/null
  code=$?
}
exited() { [[ " $* " == *" $code "* ]]; }
said() { grep -qe "$1" stdout stderr; }
python() { python3 "$here/$1.py" "${@:2}"; }
# The verdict of two conditions: 0 if the defect is there, 1 if the program is sound, and 2 if neither holds.
either() {
  eval "$1" && return 0
  eval "$2" && return 1
  return 2
}
# Copies a release, made once by each program, to `out`: that of the recipe, or that of a scene that moves far
# enough for the checks.
released() { cp -r "$made/out" out; }
moving() { cp -r "$made/moving" out; }
# Each test runs in an empty folder with the recipe. A control is a test without a fault.
control_release() {
  g release --to out r.yaml
  either '! exited 0' 'exited 0 && [ -e out/manifest.json ]'
}
tests='control_release'
for group in code files folders shared bounds products audit trees limits processes words; do
  # shellcheck source=/dev/null
  . "$here/$group.sh"
done

# Runs a test with the program of this number, and writes the verdict to a file.
verdict() {
  local name=$1 i=$2
  program=${programs[$i]} made=$base/made.$i
  cd "$base/$name.$i" || exit
  recipe >r.yaml
  "$name" >log 2>&1
  case $? in 0) echo defect ;; 1) echo sound ;; *) echo unclear ;; esac >"$base/$name.$i.part"
  mv "$base/$name.$i.part" "$base/$name.$i.verdict"
}
prepare() {
  mkdir "$base/made.$1" && cd "$base/made.$1" || exit
  recipe >r.yaml
  recipe | sed 's/gaussians: 300, views: 4, arc: 6/gaussians: 600, views: 10, arc: 30/
    s/factor: 3/factor: 4/; s/sharp]/sharp, depth, flow]/' >moving.yaml
  for to in out moving; do
    "${programs[$1]}" release -q --copy --to $to "${to/#out/r}.yaml" 2>stderr || { cat stderr >&2; exit 1; }
  done
}
(prepare 0) && (prepare 1) || exit 1

declare -A count=([0defect]=0 [1defect]=0 [1unclear]=0)
# Prints the line of the next test if both programs are done with it.
printed=0
print_next() {
  local name=${names[$printed]} i found
  [ -e "$base/$name.0.verdict" ] && [ -e "$base/$name.1.verdict" ] || return
  for i in 0 1; do
    found[i]=$(<"$base/$name.$i.verdict")
    count[$i${found[i]}]=$((${count[$i${found[i]}]:-0} + 1))
    if [ "${found[i]}" = unclear ]; then (cd "$base/$name.$i" && tail -n 8 log stdout stderr >&2); fi
  done
  printf '%-26s %-8s %s\n' "$name" "${found[@]}"
  printed=$((printed + 1))
}
printf '%-26s %-8s %s\n' finding before now
# shellcheck disable=SC2206
names=(${*:-$tests})
# Two tests more than cores at a time: many only wait.
for name in "${names[@]}"; do
  for i in 0 1; do
    while [ "$(jobs -rp | wc -l)" -gt "$(($(nproc) + 1))" ]; do wait -n; done
    mkdir "$base/$name.$i"
    verdict "$name" $i &
  done
  print_next
done
wait
while [ $printed -lt ${#names[@]} ]; do print_next || break; done
echo "${#names[@]} tests: ${count[0defect]} defects before, ${count[1defect]} now"
exit $((count[1defect] + count[1unclear] > 0))
