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

# Six photos, and a recipe with a trainer: `trained` reads its script from stdin. `$1` in it is the folder for the scene.
trained() {
  python make capture
  { echo 'if [ "$1" = --version ]; then echo 1; exit; fi'; cat; } >train.sh
  recipe | grep -v '^source\|^camera' >r.yaml
  cat >>r.yaml <<'YAML'
source: { nerfstudio: { path: capture } }
reconstruct:
  command: { program: sh, arguments: ["{train}", "{out}"], version: "1", probe: ["{train}", --version], licence: MIT,
    min_psnr: 0, scene: scene.ply, files: { train: train.sh } }
YAML
}
# The scene that a trainer leaves may be a FIFO.
endless_trained() {
  trained <<<'mkfifo "$1/scene.ply"'
  seconds=20 g build --allow-commands r.yaml
  either 'exited 124' 'exited 1 && said scene.ply'
}
# A trainer went on after the signal that ended its build: `left SIGNAL`.
left() {
  trained <<'SH'
sleep 600 & echo $! >left.pid.part
mv left.pid.part "$(dirname "$0")/left.pid"
wait
SH
  # Shells ignore some signals in the background, and `env` restores them.
  env --default-signal "$program" build --allow-commands r.yaml >stdout 2>stderr </dev/null &
  local build=$! tries=0
  until [ -e left.pid ]; do
    sleep 0.1
    if [ $((tries += 1)) = 100 ]; then return 2; fi
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
tests+=' endless_trained control_left left_by_hangup left_by_quit left_by_kill'

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
