//! `report.html`: one page that is self-contained, agrees with the release, and treats every string
//! as text.

use crate::release::small;
use crate::restricted;
use crate::support::workspace::{Workspace, same_tree, tiny_with};
use roxmltree::{Document, Node, ParsingOptions};
use std::fs;
use std::path::Path;

/// Parses the page, which must be XML too: every element closed, every value quoted, every
/// character allowed.
fn parsed(page: &str) -> Document<'_> {
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    Document::parse_with_options(page, options).unwrap()
}

fn page_of(tree: &Path) -> String {
    fs::read_to_string(tree.join("report.html")).unwrap()
}

fn elements<'a, 'd>(page: &'a Document<'d>, tag: &'a str) -> impl Iterator<Item = Node<'a, 'd>> {
    page.descendants().filter(move |node| node.has_tag_name(tag))
}

fn text(node: Node<'_, '_>) -> String {
    node.descendants().filter(Node::is_text).map(|n| n.text().unwrap()).collect()
}

/// The whole text of a page except its style sheet.
fn words(page: &Document<'_>) -> String {
    text(elements(page, "body").next().unwrap())
}

/// Number of pictures of frames and events below a node. Pictures of checks are not counted.
fn views(node: Node<'_, '_>) -> usize {
    let of_check = |n: &Node<'_, '_>| n.attribute("alt").is_some_and(|alt| alt.starts_with("check "));
    node.descendants().filter(|n| n.has_tag_name("img") && !of_check(n)).count()
}

/// A link's address, with `%XX` decoded.
fn decoded(address: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = address.as_bytes();
    while let Some((first, others)) = rest.split_first() {
        if *first == b'%' {
            bytes.push(u8::from_str_radix(std::str::from_utf8(&others[..2]).unwrap(), 16).unwrap());
            rest = &others[2..];
        } else {
            bytes.push(*first);
            rest = others;
        }
    }
    String::from_utf8(bytes).unwrap()
}

/// Checks a page with its tree: links lead to files or to parts of the page, pictures are embedded,
/// nothing is run or fetched, and ids are unique.
fn sound(tree: &Path) -> String {
    let source = page_of(tree);
    let page = parsed(&source);
    let ids: Vec<&str> = page.descendants().filter_map(|node| node.attribute("id")).collect();
    let mut once = ids.clone();
    once.sort_unstable();
    once.dedup();
    assert_eq!(once.len(), ids.len(), "{ids:?}");
    let mut files = 0;
    for link in elements(&page, "a") {
        let address = link.attribute("href").unwrap();
        if let Some(part) = address.strip_prefix('#') {
            assert!(ids.contains(&decoded(part).as_str()), "{address}");
        } else {
            assert!(tree.join(decoded(address)).is_file(), "{address}");
            files += 1;
        }
    }
    assert!(files > 10, "{files} links to files");
    for node in page.descendants().filter(Node::is_element) {
        let name = node.tag_name().name();
        assert!(!["script", "link", "iframe", "object", "embed", "form", "base"].contains(&name), "{name}");
        for attribute in node.attributes() {
            let (name, value) = (attribute.name(), attribute.value());
            assert!(!name.starts_with("on") && name != "style", "{name}={value}");
            if name == "src" {
                assert!(value.starts_with("data:image/"), "{value}");
                assert!(node.attribute("alt").is_some_and(|alt| !alt.is_empty()));
            }
        }
    }
    let table_heads = elements(&page, "th").all(|head| head.attribute("scope").is_some());
    assert!(table_heads, "a head says what it is the head of");
    source
}

#[test]
fn the_page_is_self_contained_and_its_links_hold() {
    let source = sound(small::release());
    let page = parsed(&source);
    let policy =
        elements(&page, "meta").find(|m| m.attribute("http-equiv") == Some("Content-Security-Policy"));
    let policy = policy.unwrap().attribute("content").unwrap();
    assert!(
        policy.starts_with("default-src 'none'; style-src 'sha256-") && !policy.contains("unsafe"),
        "{policy}"
    );
    // A frame in the table; a sharp frame, a blurred one, depth, flow and events of each of the two
    // trajectories.
    assert_eq!(views(page.root()), 1 + 2 * 5);
    assert!(source.contains("alt=\"check event_frame"), "a picture of what a check saw");
    assert_eq!(elements(&page, "article").count(), 2);
    let all = words(&page);
    for wanted in
        ["small/one", "base", "slow", "CC0-1.0", "procedural", "2,000 Gaussians", "PSNR not measured"]
    {
        assert!(all.contains(wanted), "{wanted} in {all}");
    }
}

/// The position of the first element of which this holds.
fn position(page: &Document<'_>, is_wanted: impl Fn(&Node<'_, '_>) -> bool) -> usize {
    page.descendants().position(|node| is_wanted(&node)).unwrap()
}

#[test]
fn pictures_come_first_and_skipped_work_last() {
    let source = page_of(small::release());
    let page = parsed(&source);
    let picture = position(&page, |node| node.has_tag_name("img"));
    for class in ["findings", "by-check"] {
        assert!(picture < position(&page, |node| node.attribute("class") == Some(class)), "{class}");
    }
    let main = elements(&page, "main").next().unwrap();
    let last = main.children().rfind(Node::is_element).unwrap();
    assert_eq!(last.attribute("id"), Some("skipped"));
    for article in elements(&page, "article") {
        let shown: Vec<&str> = article.descendants().filter_map(|node| node.attribute("alt")).collect();
        for wanted in ["sharp frame", "blurred frame", "depth at", "optical flow at"] {
            assert!(shown.iter().any(|alt| alt.starts_with(wanted)), "{wanted} in {shown:?}");
        }
    }
}

/// Tables scroll in a box of their own, so that no table widens the page of a small screen.
#[test]
fn tables_have_boxes_and_heads_are_words() {
    let source = page_of(small::release());
    let page = parsed(&source);
    for table in elements(&page, "table") {
        assert_eq!(table.parent().unwrap().attribute("class"), Some("scroll"));
    }
    let heads: Vec<String> = elements(&page, "th").map(text).collect();
    for unclear in ["of", "because", "without it", "what", "first", "traj."] {
        assert!(!heads.iter().any(|head| head == unclear), "{unclear} in {heads:?}");
    }
    assert!(heads.iter().any(|head| head == "explanation"), "{heads:?}");
}

/// Two sensors of one trajectory are in one row, with one window of time and equal axes, and each
/// picture of a check has the verdict of its own sensor.
#[test]
fn sensors_of_a_trajectory_can_be_compared() {
    let place = Workspace::new();
    let sensors = "sensors:\n  fine: { voltmeter: { preset: dvs346-paper, threshold: { on: 0.5, off: 0.5 } } }\n  \
                   coarse: { voltmeter: { preset: dvs346-paper, threshold: { on: 2.0, off: 2.0 } } }\n\
                   checks: { event_rate: { max: 0.001 }, waive: \
                   [{ check: event_rate, because: \"the limit is `max: 0.001`\" }] }\n";
    place.write("tiny.yaml", tiny_with(sensors));
    place.ok("release --to tree tiny.yaml");
    place.ok("audit tree");
    let source = sound(&place.path("tree"));
    let page = parsed(&source);
    let class = |node: &Node<'_, '_>, class| node.attribute("class") == Some(class);
    let rows = || page.descendants().filter(|node| class(node, "row") || class(node, "row plots"));
    let captions = |row: Node<'_, '_>| -> Vec<String> {
        row.descendants().filter(|node| node.has_tag_name("figcaption")).map(text).collect()
    };
    let row_of = |words: &str| {
        let mut found = rows().filter(|row| captions(*row).iter().any(|caption| caption.contains(words)));
        let row = found.next().unwrap_or_else(|| panic!("{words}"));
        assert!(found.next().is_none(), "{words}");
        row
    };
    let events = captions(row_of("events from"));
    let events: Vec<&String> = events.iter().filter(|caption| caption.contains("events from")).collect();
    let window = |caption: &str| caption.split_once("events from").unwrap().1.to_owned();
    assert_eq!(events.len(), 2);
    assert!(events[0].starts_with("coarse: ") && events[1].starts_with("fine: "), "{events:?}");
    assert_eq!(window(events[0]), window(events[1]));
    let rates = row_of("event rate");
    let axes: Vec<Vec<String>> = rates
        .children()
        .filter(|figure| captions(*figure).iter().any(|caption| caption.contains("event rate")))
        .map(|figure| figure.descendants().filter(|node| node.has_tag_name("text")).map(text).collect())
        .collect();
    assert_eq!(axes.len(), 2);
    assert_eq!(axes[0], axes[1]);
    assert!(axes[0].contains(&"events/px/s".to_owned()), "{axes:?}");
    assert!(axes[0].iter().any(|label| label.ends_with(" ms")), "{axes:?}");
    let motion = captions(row_of("check event_frame"));
    assert!(motion.iter().any(|c| c.starts_with("check event_frame, fine ")), "{motion:?}");
    assert!(motion.iter().any(|c| c.starts_with("check event_frame, coarse ")), "{motion:?}");
    assert!(!words(&page).contains('`'));
    assert!(elements(&page, "code").any(|code| text(code) == "max: 0.001"));
}

#[test]
fn the_policy_names_the_style_sheet_that_is_there() {
    use sha2::{Digest as _, Sha256};
    let source = page_of(small::release());
    let page = parsed(&source);
    let sheet = text(elements(&page, "style").next().unwrap());
    // Base 64 computed independently: six bits per digit.
    let bits: String = Sha256::digest(sheet.as_bytes()).iter().map(|b| format!("{b:08b}")).collect();
    let digits: Vec<char> = ('A'..='Z').chain('a'..='z').chain('0'..='9').chain(['+', '/']).collect();
    let digit = |six: &[u8]| {
        let six = format!("{:0<6}", std::str::from_utf8(six).unwrap());
        digits[usize::from_str_radix(&six, 2).unwrap()]
    };
    let wanted: String = bits.as_bytes().chunks(6).map(digit).collect();
    assert!(source.contains(&format!("sha256-{wanted}=&#39;")), "{wanted}");
}

#[test]
fn the_page_agrees_with_the_records() {
    let tree = small::release();
    let source = page_of(tree);
    let page = parsed(&source);
    for trajectory in ["base", "slow"] {
        let records = fs::read(tree.join(format!("small/one/{trajectory}/checks.json"))).unwrap();
        let records: Vec<serde_json::Value> = serde_json::from_slice(&records).unwrap();
        let heading = |node: &Node<'_, '_>| {
            node.children().any(|n| n.has_tag_name("h4") && text(n).starts_with(trajectory))
        };
        let article = elements(&page, "article").find(heading).unwrap();
        let table = article.descendants().find(|n| n.attribute("class") == Some("findings")).unwrap();
        let rows: Vec<Vec<String>> = table
            .descendants()
            .filter(|n| n.has_tag_name("tbody"))
            .flat_map(|body| body.children().filter(|n| n.has_tag_name("tr")))
            .map(|row| row.children().filter(Node::is_element).map(text).collect())
            .collect();
        assert_eq!(rows.len(), records.len());
        for record in &records {
            let part =
                record["subject"].as_str().unwrap().strip_prefix(&format!("small/one/{trajectory}")).unwrap();
            let [check, verdict, because] =
                ["check", "verdict", "because"].map(|key| record[key].as_str().unwrap());
            // Backticks become markup.
            let because = because.replace('`', "");
            let same = |row: &&Vec<String>| row[0] == check && row[1] == part.trim_start_matches(['/', '#']);
            let found: Vec<_> = rows.iter().filter(same).collect();
            assert!(found.iter().any(|row| row[2] == verdict && row.last() == Some(&because)), "{record}");
        }
        let scene: serde_json::Value =
            serde_json::from_slice(&fs::read(tree.join("small/one/scene.json")).unwrap()).unwrap();
        let own = scene["trajectories"].as_array().unwrap().iter().find(|t| t["name"] == trajectory).unwrap();
        let events = own["statistics"]["events"].as_u64().unwrap();
        let digits: String = text(article).chars().filter(|c| *c != ',').collect();
        assert!(digits.contains(&format!("{events} events")), "{events} in {digits}");
    }
}

/// Strings that a page must not treat as markup, as far as a recipe can contain them.
const WICKED: &str =
    "</style></p><script>alert(1)</script>\" onload=\"alert(2) ' ]]> --> &lt;b&gt; & \u{202e}desrever";

/// [`WICKED`] as the page shows it.
const TOLD: &str =
    "</style></p><script>alert(1)</script>\" onload=\"alert(2) ' ]]> --> &lt;b&gt; & [U+202E]desrever";

const RECIPE: &str = "\
version: 1
scene: a-b_c.d/e
source: { procedural: { gaussians: 200, views: 6, arc: 6 } }
camera: { width: 32, height: 18 }
trajectories: [{ name: base, refine: { factor: 2 } }]
outputs: [events, sharp]
";

#[test]
fn texts_of_a_recipe_stay_text() {
    let place = Workspace::new();
    let quoted = serde_json::to_string(WICKED).unwrap();
    place.write(
        "recipes/wicked.yaml",
        format!(
            "{RECIPE}licence: {{ expression: CC0-1.0, holder: {quoted} }}\n\
             checks: {{ event_rate: {{ max: 0.001 }}, waive: [{{ check: event_rate, because: {quoted} }}] }}\n"
        ),
    );
    place.write(
        "recipes/release.yaml",
        format!("{{ name: {quoted}, creator: {quoted}, cite_as: {quoted}, description: {quoted} }}\n"),
    );
    place.ok("release --to tree recipes");
    let source = sound(&place.path("tree"));
    let page = parsed(&source);
    let inside = |tag| elements(&page, tag).map(text).collect::<Vec<_>>().join("\n");
    assert!(inside("title").starts_with(TOLD) && inside("h1").starts_with(TOLD), "{}", inside("title"));
    assert!(inside("dd").contains(TOLD), "the holder");
    assert!(inside("td").contains(&format!("accepted: {TOLD}")), "the waiver");
    assert_eq!(
        words(&page).matches(TOLD).count(),
        8,
        "name, description, creator, holder twice, waiver twice, citation"
    );
    // As a lenient browser would read it: no tag of a recipe, in any spelling.
    assert!(!source.to_lowercase().contains("<script") && !source.contains("\u{202e}"));
    assert_eq!(source.matches("</style>").count(), 1);
}

#[test]
fn two_releases_of_one_set_of_recipes_are_the_same_page() {
    let [one, two] = [Workspace::new(), Workspace::new()];
    for (place, folder, threads) in [(&one, "out", "1"), (&two, "somewhere/else", "2")] {
        place.write("recipes/a.yaml", RECIPE);
        place.write("recipes/b.yaml", RECIPE.replace("a-b_c.d/e", "b"));
        place.ok(&format!("release -j {threads} --to {folder} recipes"));
    }
    same_tree(&one.path("out"), &two.path("somewhere/else"));
    assert!(!page_of(&one.path("out")).contains(one.path("").to_str().unwrap()));
}

#[test]
fn a_withheld_scene_shows_no_pixel() {
    let place = restricted::place();
    place.ok("release --to tree recipes");
    let source = sound(&place.path("tree"));
    let page = parsed(&source);
    let section = |id: &str| {
        let anchor = format!("scene/{id}");
        page.descendants().find(|n| n.attribute("id") == Some(&anchor)).unwrap()
    };
    let pictures = |node: Node<'_, '_>| node.descendants().filter(|n| n.has_tag_name("img")).count();
    let scenes = elements(&page, "table").find(|n| n.attribute("class") == Some("scenes")).unwrap();
    let rows = || scenes.descendants().filter(|n| n.has_tag_name("tr"));
    let row = |id: &str| rows().find(|row| text(*row).contains(id)).unwrap();
    assert_eq!((pictures(section(restricted::SCENE)), pictures(row(restricted::SCENE))), (0, 0));
    assert_eq!((views(section("own")), views(row("own"))), (2, 1));
    let all = pictures(section("own")) + pictures(row("own"));
    assert_eq!(pictures(page.root()), all, "there are no others");
    let withheld = section(restricted::SCENE);
    let curves = withheld.descendants().filter(|n| n.attribute("class") == Some("curve")).count();
    assert_eq!(curves, 1, "its speed, and not its events");
    assert!(
        text(withheld).contains("the upstream terms forbid redistribution of")
            && text(withheld).contains("pose")
    );
    assert!(words(&page).contains("Pictures and events of 1 scene are withheld"));
}
