//! Where to look: the whole picture, and overlapping tiles of it at finer scales.
//!
//! The network sees objects well that are some 12 to 250 pixels large in its input. Shrinking a large picture into that
//! input loses the washers; tiles at full scale alone cut the legs. So a picture is looked at as a whole and at scales
//! that double, as long as the tiles do not become too many.

use crate::letterbox::Window;

/// Neighbouring tiles share at least this part of their side: an object up to this size is whole in one of them.
const SHARED: f64 = 0.3;
/// A picture this much larger than the input is not worth tiles: shrinking it costs little.
const WORTH_TILES: f64 = 1.3;

/// How finely to look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tiling {
    /// The whole picture only.
    Off,
    /// The whole picture and ever finer tiles, down to full scale, but no more windows than this.
    Windows(usize),
}

/// One look: a window, and which of its sides cut through the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Look {
    /// What is looked at.
    pub window: Window,
    /// Does it have the whole picture? Then no box at its rim has been cut by it.
    pub whole: bool,
}

/// Writes the looks for a picture of this size into `looks`, the whole picture first, coarse before fine.
pub fn plan(width: u32, height: u32, side: u32, tiling: Tiling, looks: &mut Vec<Look>) {
    looks.clear();
    looks.push(Look { window: Window { left: 0, top: 0, width, height }, whole: true });
    let Tiling::Windows(most) = tiling else { return };
    let longer = f64::from(width.max(height));
    let mut tile = longer;
    // Every level halves the tile; the last one shows the picture at its own scale.
    while tile > f64::from(side) * WORTH_TILES {
        tile = (tile / 2.0).max(f64::from(side));
        let rounded = tile.round() as u32;
        let (across, down) = (starts(width, rounded), starts(height, rounded));
        if looks.len() + across.count * down.count > most {
            break;
        }
        for row in 0..down.count {
            for column in 0..across.count {
                let (left, top) = (across.at(column), down.at(row));
                let window = Window { left, top, width: rounded.min(width), height: rounded.min(height) };
                looks.push(Look { window, whole: false });
            }
        }
    }
}

/// Evenly spread tiles along one side.
struct Starts {
    count: usize,
    last: u32,
}

impl Starts {
    fn at(&self, index: usize) -> u32 {
        if self.count == 1 {
            return 0;
        }
        (f64::from(self.last) * index as f64 / (self.count - 1) as f64).round() as u32
    }
}

fn starts(length: u32, tile: u32) -> Starts {
    if length <= tile {
        return Starts { count: 1, last: 0 };
    }
    let last = length - tile;
    let step = f64::from(tile) * (1.0 - SHARED);
    Starts { count: (f64::from(last) / step).ceil() as usize + 1, last }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn planned(width: u32, height: u32, tiling: Tiling) -> Vec<Look> {
        let mut looks = Vec::new();
        plan(width, height, 320, tiling, &mut looks);
        looks
    }

    #[test]
    fn small_pictures_are_looked_at_once() {
        for (width, height) in [(320, 320), (12, 9), (400, 300)] {
            assert_eq!(planned(width, height, Tiling::Windows(100)).len(), 1, "{width} x {height}");
        }
        assert_eq!(planned(4000, 3000, Tiling::Off).len(), 1);
    }

    #[test]
    fn a_picture_of_twice_the_size_is_looked_at_whole_and_in_full_scale() {
        let looks = planned(640, 480, Tiling::Windows(100));
        assert!(looks[0].whole && looks[1..].iter().all(|look| !look.whole));
        assert!(looks[1..].iter().all(|look| (look.window.width, look.window.height) == (320, 320)));
        assert_eq!(looks.len(), 1 + 3 * 2);
    }

    proptest! {
        /// Tiles stay inside the picture and within the budget, and whatever is small enough is whole in one of them.
        #[test]
        fn nothing_falls_between_the_tiles(
            width in 1u32..2400, height in 1u32..1400, most in 1usize..60,
            x in 0.0f64..1.0, y in 0.0f64..1.0,
        ) {
            let looks = planned(width, height, Tiling::Windows(most));
            prop_assert!(looks.len() <= most.max(1));
            let levels: std::collections::BTreeSet<u32> =
                looks.iter().map(|look| look.window.width.max(look.window.height)).collect();
            for look in &looks {
                let Window { left, top, width: columns, height: rows } = look.window;
                prop_assert!(columns > 0 && rows > 0 && left + columns <= width && top + rows <= height);
            }
            for level in levels {
                let size = f64::from(level) * SHARED - 2.0;
                let (u, v) = (x * (f64::from(width) - size).max(0.0), y * (f64::from(height) - size).max(0.0));
                let whole = looks.iter().filter(|look| look.window.width.max(look.window.height) == level).any(|look| {
                    let window = look.window;
                    f64::from(window.left) <= u
                        && f64::from(window.top) <= v
                        && u + size.min(f64::from(width)) <= f64::from(window.left + window.width)
                        && v + size.min(f64::from(height)) <= f64::from(window.top + window.height)
                });
                prop_assert!(whole, "level {level}, {u} {v}");
            }
        }
    }
}
