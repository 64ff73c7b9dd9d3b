//! The path of a trajectory as seen from above and from the side.

use super::curve::stroke_path;
use gs2e_files::html::HtmlFragment;
use gs2e_trajectory::picture::PathSketch;

/// Size of a view of the path, px.
pub(super) const VIEW: [f64; 2] = [240.0, 160.0];

/// Draws both views next to each other.
pub(super) fn draw_views(html: &mut HtmlFragment, views: &[PathSketch; 2]) {
    let [width, height] = VIEW;
    let view = format!("0 0 {} {height}", 2.0 * width);
    let attributes = [("class", "path"), ("viewBox", view.as_str()), ("aria-hidden", "true")];
    html.within("svg", &attributes, |html| draw_inside(html, views));
}

/// Lines that look alike make one stroke, since a page has thousands of them.
fn draw_inside(html: &mut HtmlFragment, views: &[PathSketch; 2]) {
    let [width, height] = VIEW;
    let both = |of: &dyn Fn(&PathSketch) -> Vec<[f64; 2]>| -> String {
        let at = |(view, left): (&PathSketch, f64)| stroke_path(of(view).iter().map(|[x, y]| [x + left, *y]));
        views.iter().zip([0.0, width]).map(at).collect()
    };
    let bar = |view: &PathSketch| vec![[8.0, height - 8.0], [8.0 + view.bar, height - 8.0]];
    html.empty("path", &[("class", "way"), ("d", &(both(&|view| view.path.clone()) + &both(&bar)))]);
    for (number, (_, colour)) in views[0].frusta.iter().enumerate() {
        html.empty("path", &[("stroke", colour), ("d", &both(&|view| view.frusta[number].0.to_vec()))]);
    }
    for (view, left) in views.iter().zip([0.0, width]) {
        if let Some([x, y]) = view.path.first() {
            let [x, y] = [x + left, *y].map(|v| format!("{v:.0}"));
            html.empty("circle", &[("cx", &x), ("cy", &y), ("r", "3")]);
        }
    }
    // The views have one scale only if their paths are equally long, so each has a bar of its own.
    for (view, left) in views.iter().zip([8.0, width + 8.0]) {
        let [x, y] = [left, height - 13.0].map(|v| format!("{v:.0}"));
        html.leaf("text", &[("x", &x), ("y", &y)], &view.bar_words);
    }
}
