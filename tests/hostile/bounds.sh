# Crashes, exhaustion and unclear messages around trainings, videos and estimates.

# `--checkpoint NAME.ckpt` overwrote and removed `NAME.part`.
checkpoint_takes_part() {
  python make capture
  echo precious >p.part
  g train --capture capture/transforms.json --out o.ply --gaussians 20 --iterations 4 --checkpoint p.ckpt
  exited 0 || return 2
  either '[ ! -e p.part ]' 'grep -q precious p.part'
}
# A day of inertial samples at 100 kHz, 4 TB, was not in the estimate.
unexpected_samples() {
  recipe | grep -v '^trajectories\|^sensor\|^outputs' >imu.yaml
  cat >>imu.yaml <<'YAML'
trajectories:
  - name: base
    keyframes:
      duration: 86400
      poses: [{ position: [0, 0, -4], rotation: [0, 0, 0, 1] }, { position: [1, 0, -4], rotation: [0, 0, 0, 1] }]
sampling: { rate: 0.01 }
sensor: { esim: {} }
scale: { metres_per_unit: 1 }
imu: { rate: 100000, up: [0, 0, 1] }
outputs: [imu]
YAML
  g plan --estimate imu.yaml
  exited 0 || return 2
  either '! said " TB"' 'said " TB"'
}
# A file that an option names and that is not there was passed over.
absent_file() {
  printf '8 8\n0 1 1 1\n9 5 5 0\n' >few.txt
  g check --events few.txt --size 8x8 --camera nope.txt
  either 'exited 0' 'exited 2 && said nope.txt'
}
# The parts of an audit were written into the release, which then failed it.
parts_in_release() {
  g release --to out r.yaml
  exited 0 || return 2
  g audit out --shard 1/2 --parts out/parts
  either 'exited 0' 'exited 2 && said "in the release"'
}
# A blank behind the name of the list of scenes, which was then no list.
blank_list() {
  echo 't/tiny 2026-01-01' >'takedown.txt '
  g plan r.yaml
  either 'exited 0' 'exited 2 && said takedown.txt'
}
tests+=' checkpoint_takes_part unexpected_samples absent_file parts_in_release blank_list'
