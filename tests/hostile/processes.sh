# Signals, kills, other programs, and results that cannot be written.

# With a full disk behind stdout, verbs lost their results and ended with 0.
full_console() {
  local verb
  released
  g build r.yaml
  for verb in 'plan --json r.yaml' 'build --json r.yaml' 'check --json --recipes r.yaml' 'audit --json out' \
    'diff --json out out' 'gc --json --dry-run r.yaml' 'stress counted' --version; do
    # shellcheck disable=SC2086
    timeout 60 "$program" $verb >/dev/full 2>stderr
    code=$?
    if exited 0; then return 0; fi
    exited 1 || return 2
  done
  return 1
}
tests+=' full_console'

# A trainer went on after the signal that ended its build: `left SIGNAL`.
left() {
  python make capture
  cat >train.sh <<'SH'
if [ "$1" = --version ]; then echo 1; exit; fi
sleep 600 & echo $! >left.pid.part
mv left.pid.part "$(dirname "$0")/left.pid"
wait
SH
  recipe | grep -v '^source\|^camera' >r.yaml
  cat >>r.yaml <<'YAML'
source: { nerfstudio: { path: capture } }
reconstruct:
  command: { program: sh, arguments: ["{train}"], version: "1", probe: ["{train}", --version], licence: MIT,
    min_psnr: 0, scene: scene.ply, files: { train: train.sh } }
YAML
  # Shells ignore some signals in the background, and `env` restores them.
  env --default-signal "$program" build --allow-commands r.yaml >stdout 2>stderr </dev/null &
  local build=$! tries=0
  until [ -e left.pid ]; do
    sleep 0.1
    tries=$((tries + 1))
    if [ $tries = 100 ]; then return 2; fi
  done
  kill -"$1" $build
  wait $build
  sleep 3
  either 'kill -0 "$(<left.pid)"' true
}
left_by_hangup() { left HUP; }
left_by_quit() { left QUIT; }
left_by_kill() { left KILL; }
control_left() { left TERM; }
tests+=' control_left left_by_hangup left_by_quit left_by_kill'

# A build that was killed as it made a store left half an index, of which the next one complained.
half_index() {
  local try build
  for try in {1..40}; do
    rm -rf .gs2e
    "$program" build -q r.yaml >/dev/null 2>&1 &
    build=$!
    until [ -e .gs2e/state.db ] || ! kill -0 $build 2>/dev/null; do :; done
    kill -KILL $build 2>/dev/null
    wait $build 2>/dev/null
    g plan r.yaml
    if said 'state.db could not be read'; then return 0; fi
    exited 0 || return 2
  done
  return 1
}
tests+=' half_index'
