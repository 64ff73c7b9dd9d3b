//! The level of detail of the page. It shows less of each trajectory if there are more, so that thousands of
//! scenes still open in seconds.
//!
//! A browser takes its time for elements more than for bytes. The tree has everything that the page
//! leaves out, and the page says so.

/// Contents that are shown of each trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct DetailLevel {
    /// Maximum number of trajectories of a page of this level.
    most: usize,
    /// Width of the pictures in the table of scenes, px.
    pub(super) thumbnail: u32,
    /// Width of the pictures of trajectories, px.
    pub(super) picture: u32,
    /// True if every trajectory has pictures, with its own frames, depth and flow, and plots have axes.
    /// Otherwise the page is brief: only the first trajectory of each scene has a picture of events, and
    /// lists are short.
    pub(super) full: bool,
    /// Maximum number of pictures of checks of a trajectory.
    pub(super) check_pictures: usize,
    /// True if statements that passed are listed, and not only counted, and pictures of checks that passed
    /// are shown.
    pub(super) passes: bool,
    /// Maximum number of points of a curve.
    pub(super) points: usize,
    /// Maximum number of cameras drawn on a path.
    pub(super) cameras: usize,
}

const LARGE: DetailLevel = DetailLevel {
    most: 8,
    thumbnail: 160,
    picture: 640,
    full: true,
    check_pictures: 24,
    passes: true,
    points: 120,
    cameras: 9,
};
const WHOLE: DetailLevel = DetailLevel { most: 60, picture: 320, ..LARGE };
const PART: DetailLevel = DetailLevel {
    most: 600,
    thumbnail: 128,
    picture: 192,
    check_pictures: 3,
    passes: false,
    points: 96,
    cameras: 5,
    ..LARGE
};
const BRIEF: DetailLevel = DetailLevel {
    most: usize::MAX,
    thumbnail: 112,
    picture: 112,
    full: false,
    check_pictures: 1,
    passes: false,
    points: 40,
    cameras: 2,
};

impl DetailLevel {
    /// The level for a release of this many trajectories.
    pub(super) fn for_trajectories(trajectories: usize) -> Self {
        [LARGE, WHOLE, PART].into_iter().find(|level| trajectories <= level.most).unwrap_or(BRIEF)
    }

    /// The contents that the page leaves out, in words; `None` if it has everything.
    pub(super) fn left_out(self, trajectories: usize) -> Option<String> {
        if [LARGE, WHOLE].contains(&self) {
            return None;
        }
        let pictures = if self.full {
            "pictures are small, and of checks only those that did not pass are shown (at most three per trajectory)"
        } else {
            "pictures are small and few (one sharp frame per scene, events of its first trajectory, one check that did \
             not pass per trajectory), plots are coarse and have no axes"
        };
        let most = if self == PART { WHOLE.most } else { PART.most };
        Some(format!(
            "With {trajectories} trajectories, more than {most}, the page is kept light: {pictures}, and statements that \
             passed are counted, not listed. All of them are in checks.json of each trajectory."
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_more_there_is_the_less_is_shown_of_each() {
        let large = DetailLevel::for_trajectories(8);
        let levels = [9, 60, 61, 600, 601, 6000].map(DetailLevel::for_trajectories);
        assert_eq!(levels[0], levels[1]);
        assert_eq!(levels[2], levels[3]);
        assert_eq!(levels[4], levels[5]);
        assert!(large.picture > levels[0].picture && large.left_out(8).is_none());
        assert!(levels[1].picture > levels[2].picture && levels[3].picture > levels[4].picture);
        assert_eq!(levels[0].left_out(60), None);
        assert!(levels[2].left_out(61).unwrap().contains("61 trajectories, more than 60"));
        assert!(levels[4].left_out(6000).unwrap().contains("more than 600,"));
    }
}
