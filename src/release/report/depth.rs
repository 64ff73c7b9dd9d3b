//! The depth of the page. It shows less of each trajectory if there are more, so that thousands of
//! scenes still open in seconds.
//!
//! A browser takes its time for elements more than for bytes. The tree has everything that the page
//! leaves out, and the page says so.

/// Contents that are shown of each trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct DetailLevel {
    /// Maximum number of trajectories of a page of this depth.
    most: usize,
    /// Width of the pictures in the table of scenes, px.
    pub(super) thumbnail: u32,
    /// Width of the pictures of trajectories, px.
    pub(super) picture: u32,
    /// True if every trajectory has pictures; otherwise only the first of each scene has.
    pub(super) every: bool,
    /// True if a trajectory's own sharp frame is shown, and not only that in the table of scenes.
    pub(super) sharp: bool,
    /// Maximum number of pictures of checks of a trajectory.
    pub(super) check_pictures: usize,
    /// True if pictures of checks that passed are among them.
    pub(super) passed_pictures: bool,
    /// True if statements that passed are listed, and not only counted.
    pub(super) passes: bool,
    /// Maximum number of points of a curve.
    pub(super) points: usize,
    /// Maximum number of cameras drawn on a path.
    pub(super) cameras: usize,
}

const DEPTHS: [DetailLevel; 3] = [
    DetailLevel {
        most: 60,
        thumbnail: 160,
        picture: 320,
        every: true,
        sharp: true,
        check_pictures: 24,
        passed_pictures: true,
        passes: true,
        points: 120,
        cameras: 9,
    },
    DetailLevel {
        most: 600,
        thumbnail: 128,
        picture: 192,
        every: true,
        sharp: true,
        check_pictures: 3,
        passed_pictures: false,
        passes: false,
        points: 96,
        cameras: 5,
    },
    DetailLevel {
        most: usize::MAX,
        thumbnail: 112,
        picture: 112,
        every: false,
        sharp: false,
        check_pictures: 1,
        passed_pictures: false,
        passes: false,
        points: 40,
        cameras: 2,
    },
];

impl DetailLevel {
    /// The level for a release of this many trajectories.
    pub(super) fn for_trajectories(trajectories: usize) -> Self {
        let [whole, part, brief] = DEPTHS;
        [whole, part].into_iter().find(|depth| trajectories <= depth.most).unwrap_or(brief)
    }

    /// The contents that the page leaves out, in words; `None` if it has everything.
    pub(super) fn left_out(self, trajectories: usize) -> Option<String> {
        let [whole, part, _] = DEPTHS;
        if self == whole {
            return None;
        }
        let pictures = if self.every {
            "pictures are small, and of checks only those that did not pass are shown (three a trajectory)"
        } else {
            "pictures are small and few (a sharp frame a scene, events of its first trajectory, one check that did not pass \
             a trajectory), curves are coarse"
        };
        let most = if self == part { whole.most } else { part.most };
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
        let depths = [1, 60, 61, 600, 601, 6000].map(DetailLevel::for_trajectories);
        assert_eq!(depths[0], depths[1]);
        assert_eq!(depths[2], depths[3]);
        assert_eq!(depths[4], depths[5]);
        assert!(depths[1].picture > depths[2].picture && depths[3].picture > depths[4].picture);
        assert_eq!(depths[0].left_out(60), None);
        assert!(depths[2].left_out(61).unwrap().contains("61 trajectories, more than 60"));
        assert!(depths[4].left_out(6000).unwrap().contains("more than 600,"));
    }
}
