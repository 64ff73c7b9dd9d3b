//! The duration of a pass over rendered poses, shared out among its readers.

/// Durations of one reader of a pass.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ReaderSeconds {
    /// Its share of the pass, s: its own work, and an equal part of each rendering that it took. The
    /// shares of all readers add up to the pass.
    pub share: f64,
    /// An estimate of what it takes alone, s: its own work, and each rendering that it took.
    pub alone: f64,
    /// Its own work, s.
    work: f64,
}

impl ReaderSeconds {
    /// Adds a rendering of this duration that `readers` took, this one included.
    pub fn rendered(&mut self, seconds: f64, readers: usize) {
        self.share += seconds / readers as f64;
        self.alone += seconds;
    }

    /// Adds work of its own.
    pub fn worked(&mut self, seconds: f64) {
        self.work += seconds;
        self.share += seconds;
        self.alone += seconds;
    }
}

/// Adds what is left of the duration of a pass to the shares: to that of the reader that leads it, or to
/// all alike. The leader's durations are those of the pass without the other readers.
pub fn share_rest(readers: Vec<&mut ReaderSeconds>, leader: Option<usize>, seconds: f64) {
    let count = readers.len() as f64;
    let rest = (seconds - readers.iter().map(|reader| reader.share).sum::<f64>()).max(0.0);
    let others: f64 = readers.iter().map(|reader| reader.work).sum();
    for (index, reader) in readers.into_iter().enumerate() {
        match leader {
            Some(leader) if leader == index => {
                *reader = ReaderSeconds { share: rest, alone: seconds - others, work: rest };
            }
            Some(_) => {}
            None => {
                reader.share += rest / count;
                reader.alone += rest;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two readers with 1 s and 0.5 s of their own, of renderings of 4 s that `shared` readers took.
    fn two(shared: usize) -> [ReaderSeconds; 2] {
        [1.0, 0.5].map(|work| {
            let mut reader = ReaderSeconds::default();
            reader.rendered(3.0, shared);
            reader.rendered(1.0, shared);
            reader.worked(work);
            reader
        })
    }

    fn check(mut readers: Vec<ReaderSeconds>, leader: Option<usize>, wanted: &[[f64; 2]]) {
        share_rest(readers.iter_mut().collect(), leader, 10.0);
        let found: Vec<[f64; 2]> = readers.iter().map(|reader| [reader.share, reader.alone]).collect();
        for (found, wanted) in found.as_flattened().iter().zip(wanted.as_flattened()) {
            assert!((found - wanted).abs() < 1e-12, "{readers:?}");
        }
        let sum: f64 = readers.iter().map(|reader| reader.share).sum();
        assert!((sum - 10.0).abs() < 1e-12, "the shares add up to the pass: {sum}");
    }

    #[test]
    fn the_time_of_a_pass_is_shared_out() {
        // The leader took the renderings too, so each has a third of them. The leader did the rest.
        let [a, b] = two(3);
        let third = 4.0 / 3.0;
        let wanted = [[8.5 - 2.0 * third, 8.5], [1.0 + third, 5.0], [0.5 + third, 4.5]];
        check(vec![ReaderSeconds::default(), a, b], Some(0), &wanted);
        // Without a leader, 4.5 s are left for both.
        check(two(2).to_vec(), None, &[[5.25, 9.5], [4.75, 9.0]]);
    }
}
