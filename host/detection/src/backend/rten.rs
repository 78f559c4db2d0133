//! The default backend: rten, pure Rust, on the processor's cores.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use rten::{Model, NodeId, RunOptions, ThreadPool, Value, ValueOrView};
use rten_tensor::prelude::*;
use rten_tensor::{NdTensor, NdTensorView};

use super::bottleneck::{Bottleneck, Pointwise};
use super::depthwise::Depthwise;
use crate::card::{DepthwiseLayer, ModelError, Step};
use crate::detector::Unknown;
use crate::network::Rows;

/// An ONNX network in rten.
pub struct RtenNetwork {
    model: Model,
    input: NodeId,
    output: NodeId,
    side: usize,
    pool: Arc<ThreadPool>,
    /// The network in pieces, between the convolutions that are computed here; empty: in one piece.
    pieces: Vec<Piece>,
}

/// A part of the network, and the convolution behind it.
struct Piece {
    takes: Vec<NodeId>,
    gives: Vec<NodeId>,
    /// Nothing behind this piece needs these any more.
    last_used: Vec<NodeId>,
    layer: Option<Layer>,
}

/// A convolution channel by channel, alone or with those around it, between two tensors.
struct Layer {
    input: NodeId,
    output: NodeId,
    block: Bottleneck,
}

impl RtenNetwork {
    /// Loads an ONNX file's bytes for an input of `side` x `side` pixels, cut by its card's `steps`, to run on `threads` threads.
    ///
    /// # Errors
    /// [`ModelError::BadNetwork`]; `path` is for the message only.
    pub fn new(
        onnx: Vec<u8>,
        side: u32,
        steps: &[Step],
        threads: usize,
        path: &Path,
    ) -> Result<Self, ModelError> {
        let bad = |what: String| ModelError::BadNetwork { path: path.to_owned(), what };
        // Weights are laid out for the processor once, here, and not at every picture.
        let mut options = rten::ModelOptions::with_all_ops();
        options.prepack_weights(true);
        let model = options.load(onnx).map_err(|error| bad(error.to_string()))?;
        let ([input], [output]) = (model.input_ids(), model.output_ids()) else {
            let (inputs, outputs) = (model.input_ids().len(), model.output_ids().len());
            return Err(bad(format!("{inputs} inputs and {outputs} outputs; one of each is expected")));
        };
        let (input, output) = (*input, *output);
        let pool = Arc::new(ThreadPool::with_num_threads(threads.max(1)));
        let pieces = pieces(&model, steps).map_err(|what| {
            bad(format!("the card's steps do not fit the network: {what}; export both again, or remove `steps` from the card"))
        })?;
        Ok(Self { model, input, output, side: side as usize, pool, pieces })
    }

    fn options(&self) -> RunOptions {
        let mut options = RunOptions::default();
        options.thread_pool = Some(Arc::clone(&self.pool));
        options
    }

    /// The answer of the network in one piece.
    fn whole(&self, picture: NdTensorView<'_, f32, 4>) -> Result<Value, String> {
        let answer =
            self.model.run_n(vec![(self.input, picture.into())], [self.output], Some(self.options()));
        answer.map(|[value]| value).map_err(|error| error.to_string())
    }

    /// The answer of the network piece by piece.
    fn in_pieces(&mut self, picture: NdTensorView<'_, f32, 4>) -> Result<Value, String> {
        let options = self.options();
        let mut known: HashMap<NodeId, Value> = HashMap::new();
        for piece in &mut self.pieces {
            let mut inputs: Vec<(NodeId, ValueOrView<'_>)> = Vec::with_capacity(piece.takes.len());
            for id in &piece.takes {
                if *id == self.input {
                    inputs.push((*id, picture.into()));
                } else {
                    let value = known.get(id).ok_or("a tensor is used before it is there")?;
                    inputs.push((*id, ValueOrView::View(value.as_view())));
                }
            }
            // Between two blocks there may be nothing to do.
            if !piece.gives.is_empty() {
                let given = self
                    .model
                    .run(inputs, &piece.gives, Some(options.clone()))
                    .map_err(|error| error.to_string())?;
                known.extend(piece.gives.iter().copied().zip(given));
            }
            if let Some(layer) = &mut piece.layer {
                let value = known.get(&layer.input).ok_or("a convolution's input is not there")?;
                let filtered = layer.run(value)?;
                known.insert(layer.output, filtered);
            }
            for id in &piece.last_used {
                known.remove(id);
            }
        }
        known.remove(&self.output).ok_or_else(|| "no piece gives the answer".to_owned())
    }
}

impl Layer {
    fn run(&mut self, value: &Value) -> Result<Value, String> {
        let view: NdTensorView<'_, f32, 4> =
            value.as_view().try_into().map_err(|_| "a convolution's input is not made of numbers")?;
        // Blocks take all pictures channel by channel; one block hands them to the next as they lie.
        let by_channel = view.permuted([1, 0, 2, 3]);
        let [channels, pictures, rows, columns] = by_channel.shape();
        if channels != self.block.inputs() {
            let shape = view.shape();
            return Err(format!("a convolution of {} channels cannot take {shape:?}", self.block.inputs()));
        }
        let mut result = Vec::new();
        self.block.run(by_channel.to_contiguous().data(), [pictures, rows, columns], &mut result)?;
        let [rows_out, columns_out] = self.block.shape(rows, columns);
        let result = NdTensor::from_data([self.block.outputs(), pictures, rows_out, columns_out], result);
        Ok(result.into_permuted([1, 0, 2, 3]).into())
    }

    /// The layer that a card names, with the network's weights.
    fn find(model: &Model, layer: &DepthwiseLayer) -> Result<Self, String> {
        let numbers = |name: &String| constant(model, node(model, name)?, name);
        let pointwise = |kernel: &String, bias: &String| {
            Pointwise::new(&numbers(kernel)?, numbers(bias)?)
                .ok_or_else(|| format!("\"{kernel}\" is no kernel for single pixels"))
        };
        let before = layer.expand.as_ref().map(|expand| {
            pointwise(&expand.kernel, &expand.bias).map(|found| (found, [expand.low, expand.high]))
        });
        let behind = layer.project.as_ref().map(|project| pointwise(&project.kernel, &project.bias));
        let filter = Depthwise::new(
            numbers(&layer.kernel)?,
            numbers(&layer.bias)?,
            layer.stride,
            [layer.low, layer.high],
        )
        .ok_or_else(|| format!("\"{}\" is no kernel for every channel by itself", layer.kernel))?;
        let block = Bottleneck::new(before.transpose()?, filter, behind.transpose()?, layer.shortcut)
            .ok_or_else(|| format!("the convolutions around \"{}\" have other channels", layer.kernel))?;
        Ok(Self { input: node(model, &layer.input)?, output: node(model, &layer.output)?, block })
    }
}

fn node(model: &Model, name: &str) -> Result<NodeId, String> {
    model.find_node(name).ok_or_else(|| format!("it has no tensor \"{name}\""))
}

/// From the card's names to the loaded network's numbers.
fn pieces(model: &Model, steps: &[Step]) -> Result<Vec<Piece>, String> {
    let find_all =
        |names: &[String]| names.iter().map(|name| node(model, name)).collect::<Result<Vec<_>, _>>();
    let mut pieces = Vec::with_capacity(steps.len());
    for step in steps {
        let layer = step.depthwise.as_ref().map(|layer| Layer::find(model, layer)).transpose()?;
        let (takes, gives) = (find_all(&step.takes)?, find_all(&step.gives)?);
        pieces.push(Piece { takes, gives, last_used: Vec::new(), layer });
    }
    let mut seen = std::collections::HashSet::new();
    for piece in pieces.iter_mut().rev() {
        let own = piece.layer.iter().map(|layer| layer.input);
        let used: Vec<NodeId> = piece.takes.iter().copied().chain(own).collect();
        piece.last_used = used.into_iter().filter(|id| seen.insert(*id)).collect();
    }
    Ok(pieces)
}

/// The numbers of a tensor that no picture changes.
fn constant(model: &Model, id: NodeId, name: &str) -> Result<Vec<f32>, String> {
    let [value] = model.run_n(Vec::new(), [id], None).map_err(|error| format!("\"{name}\": {error}"))?;
    let tensor: rten_tensor::Tensor<f32> =
        value.try_into().map_err(|_| format!("\"{name}\" is not made of numbers"))?;
    Ok(tensor.to_vec())
}

impl Rows for RtenNetwork {
    fn infer(&mut self, input: &[f32], rows: &mut Vec<f32>) -> Result<(), Unknown> {
        let failed = |what: String| Unknown::Failed { what };
        let one = 3 * self.side * self.side;
        let shape = [input.len() / one, 3, self.side, self.side];
        let picture = NdTensorView::try_from_data(shape, input).map_err(|error| failed(error.to_string()))?;
        // All of it on one thread: what a piece leaves in that core's cache, the next one finds there.
        let pool = Arc::clone(&self.pool);
        let answer =
            pool.run(|| if self.pieces.is_empty() { self.whole(picture) } else { self.in_pieces(picture) });
        let answer: NdTensor<f32, 3> = answer
            .map_err(failed)?
            .try_into()
            .map_err(|_| Unknown::Nonsense { what: "the answer is not a table of numbers".to_owned() })?;
        rows.clear();
        match answer.data() {
            Some(numbers) => rows.extend_from_slice(numbers),
            None => rows.extend(answer.iter()),
        }
        Ok(())
    }
}
