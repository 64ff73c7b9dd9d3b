# Files of a person: what `release` deletes and shares, what an unreadable list means, and what other verbs replace.

# `release --to data` deleted the folder `data.partial`, for it wrote there first.
deleted_partial() {
  mkdir data.partial && echo thesis >data.partial/thesis.txt
  g release --to data r.yaml
  either '! [ -e data.partial/thesis.txt ]' 'exited 0'
}
# Even with the recipes in it.
deleted_recipes() {
  mkdir out.partial && mv r.yaml out.partial
  g release --to out out.partial/r.yaml
  either '! [ -e out.partial/r.yaml ]' 'exited 0'
}
deleted_link() {
  mkdir work && ln -s work out.partial
  g release --to out r.yaml
  either '! [ -L out.partial ]' 'exited 0'
}
# A folder with a manifest.json and a SHA256SUMS of all files was taken for a release, and replaced.
deleted_data() {
  mkdir ds && echo precious >ds/thesis.txt && echo '{}' >ds/manifest.json
  (cd ds && sha256sum manifest.json thesis.txt >SHA256SUMS)
  g release --to ds r.yaml
  either '! [ -e ds/thesis.txt ]' 'exited 2'
}
# Changes in a release were overwritten without a word.
overwritten_edit() {
  g release --copy --to out r.yaml
  echo 'My notes.' >>out/README.md
  g release --copy --to out r.yaml
  either 'exited 0 && ! grep -q notes out/README.md' 'exited 2 && grep -q notes out/README.md'
}
# `--replace` replaced the folder of the recipes, or of the scene, that the release was made from.
replaced_recipes() {
  mkdir r && mv r.yaml r
  g release --replace --to r r
  either '! [ -e r/r.yaml ]' 'exited 2'
}
replaced_scene() {
  python make capture
  mkdir given && mv capture/scene.ply given
  sourced 'nerfstudio: { path: capture }' given/scene.ply >r.yaml
  g release --replace --to given r.yaml
  either '! [ -e given/scene.ply ]' 'exited 2 && said "given holds"'
}
# Files of a release were hard links to the store, and hence to those of other releases. (A file system with
# reflinks has them instead: there, the old program is sound.)
shared_files() {
  g release --to out r.yaml
  g release --to other r.yaml
  chmod u+w out/t/tiny/base/poses.txt && echo changed >>out/t/tiny/base/poses.txt
  either 'grep -q changed other/t/tiny/base/poses.txt' 'exited 0'
}
# Two releases to one folder at the same time deleted what the other had written: half of such races left no
# release, and some one without sums.
two_releases() {
  local store round first
  for store in a b; do g release --store $store --to $store.out r.yaml; done
  for round in {1..12}; do
    rm -rf out
    "$program" release -q --store a --to out r.yaml & first=$!
    "$program" release -q --store b --to out r.yaml
    code=$?
    wait $first && exited 0 || return 0
    g audit out
    exited 0 || return 0
  done
  return 1
}
tests+=' deleted_partial deleted_recipes deleted_link deleted_data overwritten_edit replaced_recipes replaced_scene'
tests+=' shared_files two_releases'

# A list that could not be read counted as absent: `unread FILE KIND…`.
unread() {
  local file=$1 kind
  shift
  for kind; do
    rm -rf "$file" out
    case $kind in
      dangling) ln -s /nonexistent "$file" ;;
      loop) ln -s "$file" "$file" ;;
      folder) mkdir "$file" ;;
      pipe) mkfifo "$file" ;;
    esac
    g release --to out r.yaml
    if exited 0; then return 0; fi
    exited 2 && said "$file" || return 2
  done
  return 1
}
unread_takedown() { unread takedown.txt dangling loop; }
unread_defaults() { unread defaults.yaml dangling loop folder pipe; }
unread_words() { unread release.yaml dangling loop; }
unread_sources() { unread sources.yaml dangling loop; }
# A list in a folder that may not be entered. Root may enter it, unless it gives up its rights.
locked_takedown() {
  mkdir locked && echo t/tiny >locked/list.txt && chmod 0 locked
  ln -s locked/list.txt takedown.txt
  local without=()
  if [ "$(id -u)" = 0 ]; then without=(setpriv --inh-caps=-all --bounding-set=-all); fi
  timeout 60 "${without[@]}" "$program" release --to out r.yaml >stdout 2>stderr
  code=$?
  either 'exited 0 && [ -e out/t/tiny ]' 'exited 2 && said takedown.txt'
}
# Lines that can name no scene were accepted, and the scene was released.
useless_takedown() {
  local line
  for line in t/tiny/ /t/tiny '"t/tiny"' 't\tiny' 't/*'; do
    rm -rf out
    printf '%s 2025-06-01\n' "$line" >takedown.txt
    g release --to out r.yaml
    if exited 0 && ! said takedown; then return 0; fi
    exited 2 && said takedown.txt:1:1 || return 2
  done
  return 1
}
renamed_takedown() {
  local name
  for name in Takedown.txt takedown.TXT; do
    rm -rf out ./?akedown*
    echo 't/tiny 2025-06-01' >$name
    g release --to out r.yaml
    if exited 0; then return 0; fi
    exited 2 && said $name || return 2
  done
  return 1
}
tests+=' unread_takedown unread_defaults unread_words unread_sources locked_takedown useless_takedown renamed_takedown'

# `init` wrote recipes that no verb finds, or that lie under all others, for folders of these names.
lost_recipes() {
  local name
  for name in .hid defaults release sources usual; do
    python make capture
    mkdir -p data && mv capture "data/$name" && mv "data/$name/scene.ply" "data/$name/point_cloud.ply"
    sed -i "s|images/|images/$name|g" "data/$name/transforms.json"
  done
  g init nerfstudio data --to recipes --min-views 1 --min-side 1
  g plan --json recipes
  local scenes
  scenes=$(grep -o '"scene": *"[^"]*"' stdout | sort -u | wc -l)
  either '[ "$scenes" -lt 5 ]' 'exited 0 && [ "$scenes" = 5 ]'
}
# Its list of rejected scenes held tabs and line ends of their names.
broken_list() {
  local name
  for name in $'a\tb' $'a\nb'; do
    python make capture
    mkdir -p data && mv capture "data/$name"
  done
  g init nerfstudio data --to recipes
  [ -s recipes/rejected.tsv ] || return 2
  either 'awk -F "\t" "NF != 4" recipes/rejected.tsv | grep -q .' '[ "$(wc -l <recipes/rejected.tsv)" = 3 ]'
}
# `convert` replaced links and read-only files, and made private files public.
converted() {
  printf 't,x,y,p\n1,2,3,1\n' >e.csv
  eval "$1"
  g convert --size 8x8 e.csv out.npz
}
replaced_link() {
  converted ': >aim.npz; ln -s aim.npz out.npz'
  either 'exited 0 && ! [ -L out.npz ]' 'exited 0 && [ -s aim.npz ]'
}
public_file() {
  converted ': >out.npz; chmod 600 out.npz'
  either 'exited 0 && [ "$(stat -c %a out.npz)" = 644 ]' 'exited 0 && [ "$(stat -c %a out.npz)" = 600 ]'
}
replaced_read_only() {
  converted 'echo mine >out.npz; chmod 400 out.npz'
  either 'exited 0' 'exited 2 && grep -q mine out.npz'
}
replaced_pipe() {
  converted 'mkfifo out.npz'
  either 'exited 0 && ! [ -p out.npz ]' 'exited 2 && [ -p out.npz ]'
}
tests+=' lost_recipes broken_list replaced_link public_file replaced_read_only replaced_pipe'
