# Forgeries of products and exports that the audit passed with exit code 0, with the program of commit add56fde as OLD:
# a release with inertial data, objects and an export, whose forger rewrites every digest.

# Makes the release, and copies it to `out`.
products() {
  recipe | sed 's/outputs: .*/outputs: [events, sharp, segmentation, imu]/' >r.yaml
  cat >>r.yaml <<'YAML'
scale: { metres_per_unit: 0.5 }
imu: { rate: 1000, up: [0, -1, 0] }
objects:
  - name: orange
    select: { sphere: { centre: [0.32, -0.66, -0.04], radius: 0.24 } }
    path: { straight: { velocity: [0.6, 0, 0], spin: [0, 90, 0] } }
YAML
  echo 'include: [{ format: evreal, lossy: true }]' >release.yaml
  g release --copy --to out r.yaml
  exited 0
}
# Forges a file of the trajectory with a program for sed, and audits: `tampered FILE EDIT`. The forger does not rewrite
# the inputs of the checks, which the audit may name first.
tampered() {
  products || return 2
  sed -i "$2" "out/t/tiny/base/$1"
  python forge seal out
  g audit out
  either 'exited 0' "exited 3 && said 'base/$1\|the input [a-z]* of step base/checks'"
}
# Adds a file to the export, counts it, and audits.
intruder() {
  products || return 2
  local export=out/t/tiny/base/exports/evreal
  mkdir -p "$(dirname "$export/$1")" && echo 'import os' >"$export/$1"
  python forge set $export/export.json files "$(find $export -type f | wc -l)"
  python forge seal out
  g audit out
  either 'exited 0' "exited 3 && said 'exports/evreal/$1'"
}
forged_setup() { intruder setup.py; }
forged_hook() { intruder .git/hooks/post-checkout; }
forged_array() { intruder events_more.npy; }
forged_losses() { tampered exports/evreal/export.json 's/"field": "sharp"/"field": "none"/'; }
forged_metadata() { tampered exports/evreal/metadata.json 's/64/65/'; }
forged_gravity() { tampered imu/sensor.yaml 's/^gravity: .*/gravity: [0, 1.62, 0]/'; }
forged_tag() { tampered imu/sensor.yaml '$a x: !!python/object/apply:os.system [id]'; }
forged_rate() { tampered imu/sensor.yaml 's/^rate_hz: .*/rate_hz: 200/'; }
forged_velocity() { tampered segmentation/objects.csv '2s/^\(\([^,]*,\)\{10\}\)/\1-/'; }
forged_half() { tampered segmentation/objects.csv '5,$d'; }
tests+=' forged_setup forged_hook forged_array forged_losses forged_metadata forged_gravity forged_tag forged_rate'
tests+=' forged_velocity forged_half'
