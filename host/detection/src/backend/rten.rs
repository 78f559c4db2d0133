//! The default backend: rten, pure Rust, on the processor's cores.

use std::path::Path;
use std::sync::Arc;

use rten::{Model, NodeId, RunOptions, ThreadPool};
use rten_tensor::prelude::*;
use rten_tensor::{NdTensor, NdTensorView};

use crate::card::ModelError;
use crate::detector::Unknown;
use crate::network::Rows;

/// An ONNX network in rten.
pub struct RtenNetwork {
    model: Model,
    input: NodeId,
    output: NodeId,
    side: usize,
    pool: Arc<ThreadPool>,
}

impl RtenNetwork {
    /// Loads an ONNX file's bytes for inputs of `side` pixels, to run on `threads` threads.
    ///
    /// # Errors
    /// [`ModelError::BadNetwork`]; `path` is for the message only.
    pub fn new(onnx: Vec<u8>, side: u32, threads: usize, path: &Path) -> Result<Self, ModelError> {
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
        Ok(Self { model, input, output, side: side as usize, pool })
    }
}

impl Rows for RtenNetwork {
    fn infer(&mut self, input: &[f32], rows: &mut Vec<f32>) -> Result<(), Unknown> {
        let failed = |what: String| Unknown::Failed { what };
        let shape = [1, 3, self.side, self.side];
        let tensor = NdTensorView::try_from_data(shape, input).map_err(|error| failed(error.to_string()))?;
        let mut options = RunOptions::default();
        options.thread_pool = Some(Arc::clone(&self.pool));
        let [answer] = self
            .model
            .run_n(vec![(self.input, tensor.into())], [self.output], Some(options))
            .map_err(|error| failed(error.to_string()))?;
        let answer: NdTensor<f32, 3> = answer.try_into().map_err(|_| Unknown::Nonsense {
            what: "the answer is not a table of numbers for one picture".to_owned(),
        })?;
        rows.clear();
        match answer.data() {
            Some(numbers) => rows.extend_from_slice(numbers),
            None => rows.extend(answer.iter()),
        }
        Ok(())
    }
}
