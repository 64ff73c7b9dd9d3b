# Faults in the data of a release, which `check --tree` passed with exit code 0: it judged what speed.json says of
# itself, and neither frames nor depth.

# Plants a fault of plant.py, and names the check that finds it.
planted() {
  local fault=$1 of=$2 check=$3 folder=out/t/tiny/base
  moving
  case $of in
    poses) python plant "$fault" $folder/poses.txt ;;
    frames) python plant "$fault" $folder/sharp ;;
    events)
      g convert --lossy --size 64x48 $folder/events.h5 events.csv
      python plant "$fault" events.csv
      rm -f $folder/events.h5
      g convert --lossy --size 64x48 events.csv $folder/events.h5
      ;;
  esac
  g check --tree out
  either 'exited 0' "exited 3 && said '^FAIL *$check '"
}
control_planted() {
  planted nothing events .
  exited 0 && return 1
}
tests+=' control_planted'
# A fault, the data that it is in, and the check.
while read -r fault of check; do
  eval "planted_$fault() { planted $fault $of $check; }"
  tests+=" planted_$fault"
done <<'EOT'
flipped events alignment
tenth_flipped events event_frame
mirrored_x events alignment
mirrored_y events alignment
transposed events alignment
moved_column events alignment
moved_row events alignment
reversed_times events completeness
shuffled_times events completeness
later events event_times
half_time events completeness
fast_clock events event_times
rounded_times events event_times
hundredth_dropped events event_frame
fifth_dropped events event_frame
echoed events event_frame
left_missing events event_frame
end_missing events event_frame
gap events event_frame
dead_pixels events event_frame
hot_pixels events event_frame
noise events alignment
no_events events alignment
still_camera poses speed
reversed_poses poses photometric
inverse_poses poses photometric
opengl_poses poses photometric
scaled_poses poses speed
noisy_poses poses pose_continuity
faint_noise poses pose_continuity
turned_pose poses pose_continuity
swapped_poses poses pose_continuity
reversed_frames frames event_frame
EOT

# Depth, flow and frames lay in the tree, and were said to be absent.
unused_depth() {
  moving
  g check --tree out
  either 'said "no depth"' 'exited 0 && said "^pass *photometric"'
}
# No file of events, and no scene at all.
missing_events() {
  released
  rm -f out/t/tiny/base/events.h5
  g check --tree out
  either 'exited 0' 'exited 3 && said "^FAIL *records"'
}
no_scene() {
  released
  python forge set out/manifest.json scenes '[]'
  g check --tree out
  either 'exited 0' 'exited 3 && said "^FAIL *records"'
}
# A threshold that nothing reaches: a release without an event, of which nothing was said.
no_events() {
  recipe | sed 's/preset: dvs346/preset: dvs346, threshold: { on: 1000, off: 1000 }/' >r.yaml
  g release --to out r.yaml
  either 'exited 0 && ! said "no events"' 'exited 0'
}
tests+=' unused_depth missing_events no_scene no_events'
