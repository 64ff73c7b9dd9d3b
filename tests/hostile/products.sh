# Faults in products that frames do not show, found by `check --tree`. Read by before_after.sh.

# A release of inertial data alone, which needs no rendering.
inertial() {
  cat >imu.yaml <<'YAML'
version: 1
scene: t/imu
source: none
camera: { width: 48, height: 32, fx: 40 }
trajectories:
  - name: base
    keyframes:
      poses:
        - { position: [0, 0, -4], look_at: [0, 0, 0], up: [0, 1, 0] }
        - { position: [1, 0, -4], look_at: [0, 0, 0], up: [0, 1, 0] }
        - { position: [1, 1, -4], look_at: [0, 0, 0], up: [0, 1, 0] }
      duration: 0.1
outputs: [imu]
scale: { metres_per_unit: 0.5 }
imu: { up: [0, 0, 1] }
licence: { expression: CC0-1.0, holder: Nobody }
YAML
  g release --copy --to out imu.yaml
}
# Changes the columns of each sample by a program for awk, and checks the tree.
sampled() {
  inertial
  exited 0 || return 2
  awk -F, -v OFS=, "NR > 1 { $1 } 1" out/t/imu/base/imu/imu.csv >changed && mv changed out/t/imu/base/imu/imu.csv
  python forge seal out
  g check --tree out
  either 'exited 0' 'exited 3 && said "base#imu"'
}
imu_degrees() { sampled '$2 *= 57.29578; $3 *= 57.29578; $4 *= 57.29578'; }
imu_saturated() { sampled '$2 = 34.90658503988659; $3 = 0; $4 = 0'; }
imu_beyond() { sampled '$5 = 1000000; $6 = 0; $7 = 0'; }
sensor_yaml() {
  inertial
  exited 0 || return 2
  sed -i 's/^metres_per_unit: 0.5/metres_per_unit: 5/; s/data: \[1.0/data: [-1.0/' out/t/imu/base/imu/sensor.yaml
  python forge seal out
  g check --tree out
  either 'exited 0' 'exited 3 && said "base#imu"'
}
# A stereo pair that passes a moving object, in few pixels.
stereo() {
  recipe | sed 's/gaussians: 300/gaussians: 1500/; s/outputs: .*/outputs: [depth, disparity, segmentation]/' >pair.yaml
  cat >>pair.yaml <<'YAML'
rig:
  cameras:
    - { name: left }
    - { name: right, extrinsic: { position: [0.1, 0, 0] }, outputs: [depth] }
  stereo: [[left, right]]
objects:
  - name: orange
    select: { sphere: { centre: [0.32, -0.66, -0.04], radius: 0.3 } }
    path: { straight: { velocity: [1, 0, 0], spin: [0, 90, 0] } }
YAML
  g release --copy --to out pair.yaml
}
disparity_zero() {
  stereo
  exited 0 || return 2
  for file in out/t/tiny/base/left/disparity/*.npy; do
    # The numbers follow a header of 128 bytes.
    { head -c 128 "$file"; head -c 12288 /dev/zero; } >changed && mv changed "$file"
  done
  python forge seal out
  g check --tree out
  either 'exited 0' 'exited 3 && said disparity'
}
objects_reversed() {
  stereo
  exited 0 || return 2
  awk -F, -v OFS=, 'NR > 1 { $11 = -$11 } 1' out/t/tiny/base/left/segmentation/objects.csv >changed
  mv changed out/t/tiny/base/left/segmentation/objects.csv
  python forge seal out
  g check --tree out
  either 'exited 0' 'exited 3 && said objects.csv'
}
tests+=' imu_degrees imu_saturated imu_beyond sensor_yaml disparity_zero objects_reversed'
