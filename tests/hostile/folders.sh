# Folders of a person that the program took for its own, and emptied. The program of commit add56fde has these.

# Any folder became a store, and its `tmp` was emptied.
store_tmp() {
  mkdir tmp && echo thesis >tmp/thesis.txt
  g build --store . r.yaml
  either '! [ -e tmp/thesis.txt ]' 'exited 2 && [ -e tmp/thesis.txt ] && ! [ -e VERSION ]'
}
# `gc` of such a store deleted pictures.
store_frames() {
  mkdir p p/frames p/trash && echo picture >p/frames/1.png && echo old >p/trash/old.txt
  touch -d 2001-01-01 p/frames/1.png
  g build --store p r.yaml
  g gc --store p --min-age 0 r.yaml
  either '! [ -e p/frames/1.png ]' 'exited 2 && [ -e p/frames/1.png ] && [ -e p/trash/old.txt ]'
}
# A file `state.db` of another program was moved away.
store_database() {
  mkdir p && echo database >p/state.db
  g build --store p r.yaml
  either '! grep -q database p/state.db' 'exited 2 && grep -q database p/state.db'
}
# A link in a store was followed by what deletes.
store_link() {
  mkdir scratch && echo thesis >scratch/4711.0
  g build r.yaml
  rm -rf .gs2e/tmp .gs2e/gs2e-tmp
  ln -s "$PWD/scratch" .gs2e/tmp
  ln -s "$PWD/scratch" .gs2e/gs2e-tmp
  g build r.yaml
  either '! [ -e scratch/4711.0 ]' 'exited 2 && [ -e scratch/4711.0 ]'
}
# An export emptied the folder that has the name of its hidden one.
export_hidden() {
  released
  mkdir .e.gs2e-export && echo thesis >.e.gs2e-export/thesis.txt
  g export out --to dsec --lossy --out e
  either '! [ -e .e.gs2e-export/thesis.txt ]' 'exited 0 && [ -e .e.gs2e-export/thesis.txt ]'
}
# `init` deleted a list of another program, where it rejected no scene itself.
init_rejected() {
  mkdir recipes && echo mine >recipes/rejected.tsv
  python make capture
  g init nerfstudio . --to recipes --min-views 1 --min-side 1
  either '! grep -q mine recipes/rejected.tsv' 'grep -q mine recipes/rejected.tsv'
}
tests+=' store_tmp store_frames store_database store_link export_hidden init_rejected'
