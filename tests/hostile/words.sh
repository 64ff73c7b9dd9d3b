# What is accepted, refused and said, and when.

# A formula of many terms was accepted and built, and its release did not pass its own audit.
deep_formula() {
  local terms
  terms=$(printf 't+%.0s' {1..44})
  sed -i "s/function: \"1\"/function: \"${terms}1\"/" r.yaml
  g release --to out r.yaml
  either 'exited 1 && said audit' 'exited 0'
}
deep_function() {
  local open close
  open=$(printf 'sin(%.0s' {1..60})
  close=$(printf ')%.0s' {1..60})
  sed -i "s/function: \"1\"/function: \"1.1+${open}t$close\"/" r.yaml
  g release --to out r.yaml
  either 'exited 1 && said audit' 'exited 0'
}
# "Nothing ran" is what exit code 2 means, but a foreign folder was refused after the whole build.
late_refusal() {
  mkdir out && : >out/thesis.txt
  g release --to out r.yaml
  either 'exited 2 && [ -n "$(find .gs2e/ac -type f)" ]' 'exited 2'
}
# Terms: `lawful EXPRESSION` is refused by the recipe, and not released.
lawful() {
  sed -i "s/CC0-1.0/$1/" r.yaml
  g release --to out r.yaml
  either 'exited 0 1' 'exited 2 && [ ! -e .gs2e ]'
}
long_licence() { lawful "LicenseRef-$(printf 'x%.0s' {1..300})"; }
no_licence() { lawful NOASSERTION; }
foreign_licence() { lawful DocumentRef-x:LicenseRef-y; }
tests+=' deep_formula deep_function late_refusal long_licence no_licence foreign_licence'

# `--json` and a wrong command line: nothing on stdout.
silent_usage_error() {
  local verb
  for verb in build plan why check release audit diff convert init gc render simulate stress study trajectory; do
    g $verb --json --no-such-option
    exited 2 || return 2
    if ! [ -s stdout ]; then return 0; fi
  done
  return 1
}
# The same mistake was 1 in one verb and 2 in others.
absent_tree() {
  g check --tree nope
  either 'exited 1' 'exited 2'
}
# Failed checks were named on stdout only, by `check` and by `release`.
unnamed_check() {
  local verb
  echo 'checks: { event_rate: { max: 0.001 } }' >>r.yaml
  g build r.yaml
  for verb in 'check --recipes r.yaml' 'release --to out r.yaml'; do
    # shellcheck disable=SC2086
    g $verb
    exited 3 || return 2
    if ! grep -q event_rate stderr; then return 0; fi
  done
  return 1
}
# Two events of a very hot pixel in a microsecond were a fault of the stream.
hot_pixel_pairs() {
  sed -i 's/^sensor.*/sensor: { esim: { hot_pixels: { share: 0.005, rate: 1.2e5 } } }/; s/, sharp//' r.yaml
  g build r.yaml
  g check --recipes r.yaml
  either 'said "^FAIL *duplicates"' 'said "^pass *duplicates"'
}
# No line at all was a stream of 0 events; a byte order mark was an unknown column.
empty_text() {
  : >e.csv
  g convert --size 8x8 e.csv e.npz
  either 'exited 0' 'exited 1'
}
byte_order_mark() {
  printf '\357\273\277t,x,y,p\n1,2,3,1\n' >e.csv
  g convert --size 8x8 e.csv e.npz
  either '! exited 0' 'exited 0'
}
photo_with_a_nul() {
  python make capture
  sed -i 's|images/0.png|images/a\\u0000.png|' capture/transforms.json
  sourced 'nerfstudio: { path: capture }' capture/scene.ply >r.yaml
  g build r.yaml
  either 'exited 0' 'exited 1 && said "control character"'
}
# 1e300 was printed with all its digits.
long_number() {
  sed -i 's/preset: dvs346/preset: dvs346, threshold: { on: 1e300, off: 1 }/' r.yaml
  g plan r.yaml
  either 'said "0\{300\}"' 'exited 2 && said 1e300'
}
misleading_hint() {
  g build -j -1
  either "said \"use '-- -1'\"" 'exited 2'
}
tests+=' silent_usage_error absent_tree unnamed_check hot_pixel_pairs empty_text byte_order_mark photo_with_a_nul'
tests+=' long_number misleading_hint'
