//! Sweeps as drawings.

use plotters::coord::Shift;
use plotters::prelude::*;

use crate::sweep::Sweep;

/// Greatest rows per millimetre that are drawn, the same in all panels so that they compare; more is out of every useful mount.
const TOP: f64 = 8.0;

/// One panel a sweep: rows per millimetre in the stripe's middle and where it is least, over the quantity.
///
/// # Errors
/// What the drawing backend says.
pub fn draw<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    sweeps: &[Sweep],
) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
    area.fill(&WHITE)?;
    let columns = 2;
    let panels = area.split_evenly((sweeps.len().div_ceil(columns), columns));
    for (index, (panel, sweep)) in panels.iter().zip(sweeps).enumerate() {
        one(panel, sweep, index == 0)?;
    }
    Ok(())
}

fn one<B: DrawingBackend>(
    panel: &DrawingArea<B, Shift>,
    sweep: &Sweep,
    with_legend: bool,
) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
    let first = sweep.points.first().map_or(0.0, |point| point.value);
    let last = sweep.points.last().map_or(1.0, |point| point.value);
    let mut chart = ChartBuilder::on(panel)
        .margin(10)
        .x_label_area_size(38)
        .y_label_area_size(48)
        .build_cartesian_2d(first..last, 0.0..TOP)?;
    chart
        .configure_mesh()
        .x_desc(sweep.quantity.label())
        .y_desc("rows per mm of height")
        .x_labels(7)
        .max_light_lines(0)
        .draw()?;
    let measured = || sweep.points.iter().map(|point| (point.value, point.measures));
    let legend =
        |colour: RGBColor| move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2));
    let (middle, least) = (RGBColor(20, 90, 190), RGBColor(200, 110, 0));
    chart
        .draw_series(LineSeries::new(
            measured().map(|(x, found)| (x, found.middle_rows_per_mm)),
            middle.stroke_width(2),
        ))?
        .label("in the stripe's middle")
        .legend(legend(middle));
    chart
        .draw_series(LineSeries::new(
            measured().map(|(x, found)| (x, found.least_rows_per_mm)),
            least.stroke_width(2),
        ))?
        .label("where it is least")
        .legend(legend(least));
    // Where the zone does not fit into the picture the line is marked.
    chart
        .draw_series(
            measured()
                .filter(|(_, found)| !found.covers_zone)
                .map(|(x, found)| Circle::new((x, found.middle_rows_per_mm), 3, RED.filled())),
        )?
        .label("zone not whole in the picture")
        .legend(|(x, y)| Circle::new((x + 9, y), 3, RED.filled()));
    if with_legend {
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperLeft)
            .border_style(BLACK)
            .background_style(WHITE.mix(0.8))
            .draw()?;
    }
    Ok(())
}
