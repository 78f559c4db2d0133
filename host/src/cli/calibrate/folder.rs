//! Which picture of a folder is what, by its name.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

/// The pictures of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Files {
    /// The board on the floor.
    pub floor: PathBuf,
    /// The clean stripe.
    pub stripe: PathBuf,
    /// Blocks by height, millimetres.
    pub blocks: Vec<(f64, PathBuf)>,
    /// Further views of the board.
    pub lens_views: Vec<PathBuf>,
}

impl Files {
    /// Sorts the pictures of a directory by their names: `board*`, `stripe*`, `block60*` or `step60*`, `lens*`.
    /// Pictures of other names are left alone.
    ///
    /// # Errors
    /// The directory cannot be read, a picture is missing, or there are two where one is meant.
    pub fn in_folder(folder: &Path, only: Option<&str>) -> anyhow::Result<Self> {
        let entries =
            std::fs::read_dir(folder).with_context(|| format!("{}: cannot read it", folder.display()))?;
        let mut paths: Vec<PathBuf> = entries
            .map(|entry| entry.map(|entry| entry.path()))
            .collect::<Result<_, _>>()
            .with_context(|| format!("{}: cannot read it", folder.display()))?;
        paths.sort();
        let (mut boards, mut stripes, mut blocks, mut lens_views) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for path in paths {
            let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
            let is_picture = [".png", ".jpg", ".jpeg"].iter().any(|ending| name.ends_with(ending));
            if !is_picture || only.is_some_and(|text| !name.contains(&text.to_lowercase())) {
                continue;
            }
            if name.starts_with("board") {
                boards.push(path);
            } else if name.starts_with("stripe") {
                stripes.push(path);
            } else if name.starts_with("lens") {
                lens_views.push(path);
            } else if let Some(height) = block_height(&name) {
                blocks.push((height, path));
            }
        }
        let single = |what: &str, mut found: Vec<PathBuf>| match (found.pop(), found.is_empty()) {
            (Some(path), true) => Ok(path),
            (None, _) => bail!("{}: no picture named {what}*; see --help for the names", folder.display()),
            (Some(_), false) => bail!(
                "{}: several pictures named {what}*; choose one set with --only TEXT, or name further views lens*",
                folder.display()
            ),
        };
        Ok(Self { floor: single("board", boards)?, stripe: single("stripe", stripes)?, blocks, lens_views })
    }
}

/// `block60_low.png` is 60, `step120.png` is 120.
fn block_height(name: &str) -> Option<f64> {
    let rest = name.strip_prefix("block").or_else(|| name.strip_prefix("step"))?;
    let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
    digits.parse().ok().filter(|height| *height > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_what_a_picture_shows() {
        let folder = tempfile::tempdir().unwrap();
        for name in
            ["board_a.png", "stripe_a.png", "step60_a.png", "block120_a.jpg", "lens1_a.png", "notes.txt"]
        {
            std::fs::write(folder.path().join(name), b"").unwrap();
        }
        let files = Files::in_folder(folder.path(), None).unwrap();
        assert_eq!(files.blocks.iter().map(|block| block.0).collect::<Vec<_>>(), [120.0, 60.0]);
        assert_eq!(files.lens_views.len(), 1);
        std::fs::write(folder.path().join("board_b.png"), b"").unwrap();
        let several = Files::in_folder(folder.path(), None).unwrap_err().to_string();
        assert!(several.contains("--only"), "{several}");
        assert!(Files::in_folder(folder.path(), Some("_A")).is_ok(), "case does not matter");
        let none = Files::in_folder(folder.path(), Some("_c")).unwrap_err().to_string();
        assert!(none.contains("no picture named board*"), "{none}");
    }
}
