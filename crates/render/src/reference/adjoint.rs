//! The raster pass backwards in f64, pixel by pixel: the sums of each layer from which the projection
//! goes back to the parameters. Tests compare the gradients of the back ends with it.

use super::parameters::{GaussianRates, RatedGaussian};
use super::{ReferenceLayer, ReferenceRenderer, RenderError, RenderRules};
use crate::shared::MAX_ALPHA;
use gs2e_scene::camera::view::CameraView;
use std::f64::consts::LOG2_E;

/// A layer, and its sums over the pixels of the image.
pub(crate) struct LayerSums {
    /// Index of the Gaussian in the scene.
    pub(crate) index: usize,
    /// World directions of its axes, scaled by the standard deviations.
    pub(crate) axes: [[f64; 3]; 3],
    /// Opacity at the mean, without the factor of the antialiased rule.
    pub(crate) opacity: f64,
    /// The Cholesky form, in units in which the opacity falls as `2^-|W d|^2`, 1/px.
    pub(crate) w: [f64; 3],
    /// True for each colour above 0.
    pub(crate) lit: [bool; 3],
    /// With `a = dL/d ln(alpha before the cap and the ramp)` and `e = W d`: the sums of a, a e1, a e2,
    /// a e1^2, a e1 e2, a e2^2; of the blended weight times the gradient by each colour; and of the
    /// weight times the score.
    pub(crate) sums: [f64; 10],
}

/// The sums of all layers of a view, for the gradient of a loss by each pixel's colour.
///
/// # Errors
/// The view cannot be rendered.
pub(crate) fn layer_sums(
    renderer: &ReferenceRenderer,
    view: &CameraView,
    by_pixel: &[[f32; 3]],
    score: &[f32],
) -> Result<Vec<LayerSums>, RenderError> {
    let (layers, _) = renderer.layers(view, |_| GaussianRates::default())?;
    let mut all: Vec<LayerSums> = layers.iter().map(|layer| empty_sums(renderer, layer)).collect();
    let width = view.camera.size.width as usize;
    for (i, (gradient, score)) in by_pixel.iter().zip(score).enumerate() {
        let pixel = [i % width, i / width];
        let here: Vec<&ReferenceLayer> =
            layers.iter().filter(|layer| layer.rows.contains(&pixel[1])).collect();
        for (layer, more) in pixel_terms(renderer, &here, pixel, gradient.map(f64::from), (*score).into()) {
            let place = layers.iter().position(|one| one.order == layer.order);
            let sums = &mut all[place.expect("a layer of the view")].sums;
            sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        }
    }
    Ok(all)
}

fn empty_sums(renderer: &ReferenceRenderer, layer: &ReferenceLayer) -> LayerSums {
    let index = layer.order.1;
    let gaussian = RatedGaussian::new(&renderer.scene, index, &GaussianRates::default());
    LayerSums {
        index,
        axes: gaussian.axes().map(|axis| axis.map(|entry| entry.value)),
        opacity: gaussian.opacity().value,
        w: layer.w.map(|w| w.value * (LOG2_E / 2.0).sqrt()),
        lit: layer.colour.map(|c| c.value > 0.0),
        sums: [0.0; 10],
    }
}

/// The terms of each layer that is blended at a pixel.
fn pixel_terms<'a>(
    renderer: &ReferenceRenderer,
    layers: &[&'a ReferenceLayer],
    pixel: [usize; 2],
    gradient: [f64; 3],
    score: f64,
) -> Vec<(&'a ReferenceLayer, [f64; 10])> {
    let (blend, rest, _) = renderer.blended_layers(layers, pixel);
    // The back ends recover the light in front of a layer by division. Here it is kept on the way
    // forward, so that an error of theirs cannot be repeated.
    let dot = |c: [f64; 3]| c[0] * gradient[0] + c[1] * gradient[1] + c[2] * gradient[2];
    let mut light = 1.0;
    let before: Vec<f64> = blend
        .iter()
        .map(|(_, alpha)| {
            let here = light;
            light *= 1.0 - alpha.value;
            here
        })
        .collect();
    let mut behind = rest.value * dot(renderer.style.background.map(f64::from));
    let mut terms = Vec::new();
    for (&(layer, alpha), &light) in blend.iter().zip(&before).rev() {
        let weight = light * alpha.value;
        let lit = dot(layer.colour.map(|c| c.value));
        let by_alpha = light * lit - behind / (1.0 - alpha.value);
        behind += weight * lit;
        let [dx, dy] = [0, 1].map(|k| pixel[k] as f64 + 0.5 - layer.mean[k].value);
        let [w1, w2, w3] = layer.w.map(|w| w.value * (LOG2_E / 2.0).sqrt());
        let (e1, e2) = (w1 * dx + w2 * dy, w3 * dy);
        let free = layer.opacity.value * (-(e1 * e1 + e2 * e2)).exp2();
        // Ten sums of a layer are all that the projection needs of its pixels.
        let a = by_alpha * opacity_slope(renderer.style.rules, free);
        let [r, g, b] = gradient.map(|g| weight * g);
        terms.push((
            layer,
            [a, a * e1, a * e2, a * e1 * e1, a * e1 * e2, a * e2 * e2, r, g, b, weight * score],
        ));
    }
    terms
}

/// The derivative of the blended opacity by the logarithm of the free one.
fn opacity_slope(rules: RenderRules, free: f64) -> f64 {
    // A capped opacity does not follow a small change.
    if free >= f64::from(MAX_ALPHA) {
        return 0.0;
    }
    if rules != RenderRules::Soft {
        return free;
    }
    let u = (255.0 * free - 0.5).clamp(0.0, 1.0);
    // Where the ramp is cut, `6u - 6u^2` is 0 as well.
    free * (u * u * (3.0 - 2.0 * u) + free * 255.0 * 6.0 * u * (1.0 - u))
}
