# Small files that took the program down: panics, aborts, memory and time without end.

# `--json` with a path that is not UTF-8 panicked, in every verb that prints paths.
panicked_on_bytes() {
  local odd verb
  odd=$(printf 'x\377')
  python make capture
  mkdir -p "$odd/data" && cp -r capture "$odd" && cp r.yaml "$odd" && cp -r capture "$odd/data/one"
  printf 't,x,y,p\n1,2,3,1\n' >"$odd/e.csv"
  for verb in 'plan --store ODD/.gs2e ODD/r.yaml' 'build --store ODD/.gs2e ODD/r.yaml' \
    'release --store ODD/.gs2e --to ODD/out ODD/r.yaml' 'convert --size 8x8 ODD/e.csv ODD/e.npz' \
    'render --scene ODD/capture/scene.ply --view ODD/capture/transforms.json --out ODD/seen.png' \
    'init nerfstudio ODD/data --to ODD/recipes --min-views 1 --min-side 1'; do
    # shellcheck disable=SC2086
    g --json ${verb//ODD/$odd}
    if exited 101; then return 0; fi
    exited 0 || return 2
  done
  return 1
}
# In such a folder, `release` put the tree in place and then failed.
late_failure_on_bytes() {
  local odd
  odd=$(printf 'x\377')
  mkdir "$odd" && cp r.yaml "$odd"
  g -C "$odd" release --to out r.yaml
  either '! exited 0 && [ -e "$odd/out/manifest.json" ]' 'exited 0'
}
# A sensor of 65535x65535 in a file of a few events.
huge_sensor() {
  printf '346 260\n0 1 1 1\n9 345 259 1\n' >few.txt
  g convert few.txt in.h5
  python make sensor
  g convert in.h5 x.png
  either 'exited 134' 'exited 1 && said 65535'
}
tests+=' panicked_on_bytes late_failure_on_bytes huge_sensor'

# Files without an end, or that nothing is ever written to: `endless FILE ARGUMENT…` puts a FIFO and a link to
# /dev/zero in the place of a file, and runs a verb.
endless() {
  local file=$1 kind
  shift
  for kind in pipe device; do
    rm -rf "$file"
    if [ $kind = pipe ]; then mkfifo "$file"; else ln -s /dev/zero "$file"; fi
    seconds=20 g "$@"
    # 124: time is over; 134 and 137: memory is.
    if exited 124 134 137 || said 'out of memory'; then return 0; fi
    exited 1 2 3 && said "${file##*/}" || return 2
  done
  return 1
}
endless_recipe() { endless z.yaml plan z.yaml; }
endless_takedown() { endless takedown.txt plan r.yaml; }
endless_scene() {
  python make capture
  local kind found=1
  for kind in ply splat spz sog; do
    sourced 'nerfstudio: { path: capture }' x.$kind >r.yaml
    endless x.$kind plan r.yaml
    found=$?
    [ $found = 1 ] || break
  done
  return $found
}
endless_capture() {
  python make capture
  sourced 'nerfstudio: { path: capture }' capture/scene.ply >r.yaml
  endless capture/transforms.json plan r.yaml
}
endless_model() {
  sourced 'model: { path: cameras.json }' x.ply >r.yaml
  endless cameras.json plan r.yaml
}
endless_photo() {
  python make capture
  endless capture/images/3.png simulate --frames capture/images --fps 1000 --sensor dvs346 --out e.h5
}
endless_sums() {
  released
  endless out/SHA256SUMS audit out
}
endless_manifest() {
  released
  endless out/manifest.json check --tree out
}
endless_poses() {
  released
  endless out/t/tiny/base/poses.txt check --tree out
}
endless_events() {
  released
  endless out/t/tiny/base/events.h5 check --tree out
}
# A blob of the store that has become a FIFO.
endless_blob() {
  g build r.yaml
  g plan --json r.yaml
  local blob
  blob=$(grep -o '"path": *"[^"]*"' stdout | head -n 1 | cut -d '"' -f 4)
  rm -f "$blob" && mkfifo "$blob"
  seconds=20 g release --to out r.yaml
  either 'exited 124' 'exited 0 && [ -f "$blob" ]'
}
tests+=' endless_recipe endless_takedown endless_scene endless_capture endless_model endless_photo endless_sums'
tests+=' endless_manifest endless_poses endless_events endless_blob'

# Files of some kB that claim gigabytes.
bomb_picture() {
  python make picture
  g simulate --frames frames --fps 1000 --sensor dvs346 --out e.npz
  either 'exited 124 134' 'exited 2 && said 65535'
}
bomb_scene() {
  python make scene
  g convert in.sog out.ply
  either 'exited 0 124 134' 'exited 1 && said 16383'
}
# Events at one time were sorted again with every chunk.
bomb_events() {
  python make events
  seconds=20 g convert --size 346x260 in.npz out.h5
  either 'exited 0 124 134' 'exited 1 && said 4194304'
}
# EVT 3.0 has a word for each 4.2 s, so that two events far apart made a file of a gigabyte.
bomb_silence() {
  printf '346 260\n0 1 1 1\n%d 1 1 1\n' $((1 << 51)) >in.txt
  (ulimit -f 200000 && g convert --codec evt3 in.txt out.raw; exit $code)
  code=$?
  either 'exited 0 124 134 153 || said "File too large"' 'exited 1 && [ ! -e out.raw ]'
}
bomb_index() {
  released
  python make index
  mv -f index.parquet out
  python forge seal out
  g audit out
  either 'exited 124 134' 'exited 3 && said "^error: index.parquet: "'
}
# Hot pixels were not counted among the noise that a recipe may ask for.
bomb_hot_pixels() {
  recipe | sed 's/preset: dvs346/preset: dvs346, hot_pixels: { share: 1, rate: 1e6 }/' >r.yaml
  g plan r.yaml
  either 'exited 0' 'exited 2 && said hot_pixels'
}
# Threads were made whatever the number of cores. (They took a minute for their work; here, their stacks take more
# addresses than there are.)
bomb_threads() {
  g build -j4096 r.yaml
  either 'exited 1 101 124 134' 'exited 0 && said "j 4096"'
}
tests+=' bomb_picture bomb_scene bomb_events bomb_silence bomb_index bomb_hot_pixels bomb_threads'

# Links led a search for recipes, or for photos, over the whole machine.
walked_link() {
  mkdir -p outside recipes && recipe | sed 's|t/tiny|t/outside|' >outside/o.yaml && mv r.yaml recipes
  ln -s ../outside recipes/p.yaml
  seconds=20 g plan recipes
  either 'exited 0 && said t/outside' 'exited 2 && said "a link leads"'
}
walked_root() {
  mkdir recipes && mv r.yaml recipes && ln -s / recipes/all
  seconds=20 g plan recipes
  either 'exited 124 || ! said recipes/all' 'exited 2 && said recipes/all'
}
walked_capture() {
  sourced 'colmap: { path: / }' x.ply >r.yaml
  g plan r.yaml
  either 'exited 124 || said "no COLMAP model"' 'exited 1 2 && said "another file system"'
}
tests+=' walked_link walked_root walked_capture'
