//! `nearfield dataset`: arguments and progress.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

use crate::dataset::{Progress, Recipe, Split, make};
use crate::items::{CLASSES, TRAINED};
use crate::sheet;

/// Make pictures to train and judge the detector
#[derive(Debug, Args)]
pub struct DatasetArguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    Make(Make),
    Show(Show),
    Sprites(Sprites),
}

/// Make a dataset: pictures, COCO and YOLO labels, card. The same arguments give the same bytes; a run that was
/// interrupted is continued by the same command.
#[derive(Debug, Args)]
struct Make {
    /// Folder to write to; it is made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seed of all draws
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Pictures in train, val and test_picture together
    #[arg(long, default_value_t = 5000)]
    images: usize,
    /// How they are split: train/val/test_picture [default: 70 %, 10 %, 20 %]
    #[arg(long, value_name = "A/B/C")]
    split: Option<String>,
    /// Pictures in test_item and in test_floor, each [default: half of test_picture]
    #[arg(long)]
    unseen: Option<usize>,
    /// Longest side of the pictures in pixels, one number or a range
    #[arg(long, value_name = "LOW..HIGH", default_value = "288..448")]
    size: String,
    /// Write one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// Write a sheet of items: a row for every class, an item in every column
#[derive(Debug, Args)]
struct Show {
    /// Classes to show [default: the trained ones]; `all` for all
    #[arg(value_name = "CLASS")]
    classes: Vec<String>,
    /// PNG or JPEG to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Number of the first item
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Items of every class
    #[arg(long, default_value_t = 8)]
    items: usize,
    /// Pixels of every picture
    #[arg(long, default_value_t = 160)]
    pixels: usize,
}

/// Write cut-outs of items: 8 angles in 5 lights each, transparent outside the item and its shadow
#[derive(Debug, Args)]
struct Sprites {
    /// Folder to write to: CLASS/NUMBER/ANGLE_LIGHT.png
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Classes [default: the trained ones]
    #[arg(value_name = "CLASS")]
    classes: Vec<String>,
    /// Items of every class
    #[arg(long, default_value_t = 16)]
    items: u64,
    /// Pixels of the longest side
    #[arg(long, default_value_t = 192)]
    pixels: usize,
}

struct Bar(ProgressBar);

impl Progress for Bar {
    fn picture(&self, split: Split) {
        self.0.set_message(split.name());
        self.0.inc(1);
    }
}

fn bar(count: usize) -> anyhow::Result<ProgressBar> {
    let style = ProgressStyle::with_template("{msg:12} {wide_bar} {pos}/{len} {per_sec} {eta}")?;
    Ok(ProgressBar::new(count as u64).with_style(style))
}

impl DatasetArguments {
    /// Runs the command. Returns the lines for standard output.
    ///
    /// # Errors
    /// Arguments that make no sense, files that cannot be written.
    pub fn run(&self) -> anyhow::Result<Vec<String>> {
        match &self.verb {
            Verb::Make(make) => make.run(),
            Verb::Show(show) => show.run(),
            Verb::Sprites(sprites) => sprites.run(),
        }
    }
}

/// `3500/500/1000`, or its default for a number of pictures.
fn parse_split(text: Option<&str>, images: usize) -> anyhow::Result<[usize; 3]> {
    let Some(text) = text else {
        let (val, test) = (images / 10, images / 5);
        return Ok([images - val - test, val, test]);
    };
    let parts: Vec<usize> = text
        .split('/')
        .map(|part| {
            part.trim()
                .parse()
                .with_context(|| format!("--split {text}: give three numbers, as 3500/500/1000"))
        })
        .collect::<anyhow::Result<_>>()?;
    let Ok(split) = <[usize; 3]>::try_from(parts) else {
        bail!("--split {text}: give three numbers, as 3500/500/1000");
    };
    if split.iter().sum::<usize>() != images {
        bail!(
            "--split {text} makes {} pictures, but --images is {images}: make them agree",
            split.iter().sum::<usize>()
        );
    }
    Ok(split)
}

/// `320` or `320..512`.
fn parse_size(text: &str) -> anyhow::Result<(usize, usize)> {
    let number = |part: &str| {
        part.trim().parse::<usize>().with_context(|| format!("--size {text}: give 320 or 320..512"))
    };
    match text.split_once("..") {
        Some((low, high)) => Ok((number(low)?, number(high)?)),
        None => Ok((number(text)?, number(text)?)),
    }
}

fn parse_classes(names: &[String]) -> anyhow::Result<Vec<usize>> {
    if names.is_empty() {
        return Ok((0..TRAINED).collect());
    }
    if names.iter().any(|n| n == "all") {
        return Ok((0..CLASSES.len()).collect());
    }
    let place = |name: &String| {
        let known = || CLASSES.map(|c| c.name).join(", ");
        CLASSES
            .iter()
            .position(|c| c.name == name)
            .with_context(|| format!("no class {name}; there are {}", known()))
    };
    names.iter().map(place).collect()
}

impl Make {
    fn run(&self) -> anyhow::Result<Vec<String>> {
        let split = parse_split(self.split.as_deref(), self.images)?;
        let unseen = self.unseen.unwrap_or(split[2] / 2);
        let recipe = Recipe::new(self.seed, split, unseen, parse_size(&self.size)?)?;
        let bar = Bar(bar(recipe.splits().iter().map(|s| s.1).sum())?);
        let splits = make(&self.out, &recipe, &bar)?;
        bar.0.finish_and_clear();
        let count = |pictures: &[crate::dataset::PictureTruth]| {
            pictures.iter().map(|p| p.objects.len()).sum::<usize>()
        };
        if self.json {
            let parts: Vec<_> = splits
                .iter()
                .map(
                    |(s, p)| serde_json::json!({"split": s.name(), "pictures": p.len(), "objects": count(p)}),
                )
                .collect();
            return Ok(vec![
                serde_json::json!({"out": self.out, "recipe": recipe, "splits": parts}).to_string(),
            ]);
        }
        let line = |(split, pictures): &(Split, Vec<_>)| {
            format!("{:13} {:6} pictures {:7} objects", split.name(), pictures.len(), count(pictures))
        };
        Ok(splits.iter().map(line).chain([format!("written to {}", self.out.display())]).collect())
    }
}

impl Show {
    fn run(&self) -> anyhow::Result<Vec<String>> {
        let classes = parse_classes(&self.classes)?;
        if self.items == 0 || !(16..=1024).contains(&self.pixels) {
            bail!("--items must be 1 or more, --pixels 16 to 1024");
        }
        let sheet = sheet::sheet(&classes, self.first, self.items, self.pixels);
        sheet
            .save(&self.out)
            .with_context(|| format!("{}: the sheet cannot be written", self.out.display()))?;
        let names: Vec<_> = classes.iter().map(|&c| CLASSES[c].name).collect();
        Ok(vec![format!("{}: rows {}", self.out.display(), names.join(", "))])
    }
}

impl Sprites {
    fn run(&self) -> anyhow::Result<Vec<String>> {
        let classes = parse_classes(&self.classes)?;
        let bar = bar(classes.len() * self.items as usize)?;
        let count = crate::sprite::write_all(&self.out, &classes, self.items, self.pixels, &|| bar.inc(1))?;
        bar.finish_and_clear();
        Ok(vec![format!("{count} cut-outs written to {}", self.out.display())])
    }
}
