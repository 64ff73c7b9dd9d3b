# Members of a shared store who make mistakes, or worse.

# A program that answers as Slurm would, and keeps the script. Paths are absolute.
fake_slurm() {
  mkdir bin
  cat >bin/sbatch <<'SH'
#!/bin/sh
for script in "$@"; do :; done
cp "$script" "$FAKE/script"
echo 41
SH
  printf '#!/bin/sh\n' >bin/squeue
  chmod +x bin/*
  export FAKE=$PWD PATH=$PWD/bin:$PATH TMPDIR=$PWD
}
# Runs a task of the script that was submitted.
task() { SLURM_ARRAY_JOB_ID=41 SLURM_ARRAY_TASK_ID=1 timeout 60 sh script >>stdout 2>>stderr; }

# A task ran the commands of a recipe that another member had put into its shard.
altered_shard() {
  fake_slurm
  g submit --to slurm --shared-store shared --detach --allow-commands r.yaml
  exited 0 || return 2
  recipe | sed 's|t/tiny|t/evil|; /^source/d' >evil.yaml
  cat >>evil.yaml <<YAML
source: { nerfstudio: { path: capture } }
reconstruct:
  command: { program: sh, arguments: ["{train}", "{out}"], version: "1", probe: ["{train}", --version], licence: MIT,
    min_psnr: 0, scene: scene.ply, files: { train: train.sh } }
YAML
  python make capture
  echo "touch '$PWD/PWNED'; echo 1" >train.sh
  local shard
  shard=$(find shared -name shard-0001.json)
  sed -i "s|\"recipes\":\[|&{\"recipe\":\"$PWD/evil.yaml\",\"defaults\":null},|" "$shard"
  task
  either '[ -e PWNED ]' 'grep -rq "was altered" shared/*plans'
}
tests+=' altered_shard'
# The results of a task went through a link.
linked_results() {
  fake_slurm
  g submit --to slurm --shared-store shared --detach r.yaml
  exited 0 || return 2
  local results
  results=$(find shared -name results)
  mkdir victim && rmdir "$results" && ln -s "$PWD/victim" "$results"
  task
  either '[ -n "$(ls victim)" ]' true
}
tests+=' linked_results'
# The plan of one member stopped all others.
unread_plan() {
  fake_slurm
  g submit --to slurm --shared-store shared --detach r.yaml
  exited 0 || return 2
  local plan
  plan=$(find shared -name plan.json)
  mkdir "$(dirname "$plan")/../0123456789ab"
  echo '{' >"$(dirname "$plan")/../0123456789ab/plan.json"
  g status --shared-store shared r.yaml
  either 'exited 2' 'exited 0'
}
tests+=' unread_plan'
# A FIFO in the place of a blob stopped a build for ever.
fifo_blob() {
  g build --store one --shared-store shared r.yaml
  exited 0 || return 2
  local blob
  blob=$(find shared/cas -type f | head -n 1)
  rm -f "$blob" && mkfifo "$blob"
  seconds=20 g build --store two --shared-store shared r.yaml
  either 'exited 124' 'exited 0'
}
tests+=' fifo_blob'
# A folder in the place of a blob was an error each time.
folder_blob() {
  g build --store one --shared-store shared r.yaml
  exited 0 || return 2
  local blob
  blob=$(find shared/cas -type f | head -n 1)
  rm -f "$blob" && mkdir "$blob"
  g build --store two --shared-store shared r.yaml
  either '! exited 0' '[ -f "$blob" ]'
}
tests+=' folder_blob'
# A collection deleted what lay behind a link.
linked_trash() {
  g build --store one --shared-store shared r.yaml
  exited 0 || return 2
  mkdir -p victim/photos && echo x >victim/photos/1.jpg
  find victim -exec touch -d '9 days ago' {} +
  local name
  for name in trash tmp plans gs2e-trash gs2e-tmp gs2e-plans; do
    rm -rf "shared/$name" && ln -s ../victim "shared/$name"
  done
  g gc --shared-store shared --older-than 1d
  either '! [ -e victim/photos/1.jpg ]' true
}
tests+=' linked_trash'
# A folder with characters that cannot be seen was another one in the script.
hidden_folder() {
  fake_slurm
  local shared=$PWD/sha$'\u00ad'red
  g submit --to slurm --shared-store "$shared" --detach r.yaml
  exited 0 || return 2
  task
  either '[ -z "$(find "$shared/ac" -name "*.json")" ]' true
}
tests+=' hidden_folder'
# A recipe whose path is not UTF-8 ended `submit` with a panic.
byte_recipe() {
  fake_slurm
  local folder=$'re\xff'
  mkdir "$folder" && cp r.yaml "$folder"
  g submit --to slurm --shared-store shared --detach "$folder"
  either 'exited 101' 'exited 0 && task'
}
tests+=' byte_recipe'
# The number of shares decided how much memory was asked for.
many_shares() {
  g build --shard 2/4294967295 r.yaml
  either 'exited 134' 'exited 0'
}
tests+=' many_shares'
many_parts() {
  released
  mkdir parts
  g audit out --parts parts --shard 1/4294967295
  exited 0 || return 2
  g audit out --parts parts
  either 'exited 134' 'exited 2 && said "is missing"'
}
tests+=' many_parts'
# A wrong record was copied, whatever share was asked for.
wrong_record() {
  g build --store one --shared-store shared r.yaml
  exited 0 || return 2
  g build --store two --shared-store shared --recheck 1 r.yaml
  either '! said rerun' 'said "of the shared store rerun"'
}
tests+=' wrong_record'
