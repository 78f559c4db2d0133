//! Microsoft's ONNX Runtime: quicker than rten, and the only one here that gains from 8 bits.
//!
//! Its shared library is opened while running: by default `libonnxruntime.so`, or the file that the environment variable
//! `ORT_DYLIB_PATH` names (the Python package `onnxruntime` brings one along).

use std::path::Path;

use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::TensorRef;

use crate::card::ModelError;
use crate::detector::Unknown;
use crate::network::Rows;

/// An ONNX network in ONNX Runtime.
pub struct OrtNetwork {
    session: Session,
    side: usize,
}

impl OrtNetwork {
    /// Loads an ONNX file's bytes for inputs of `side` pixels, to run on `threads` threads.
    ///
    /// # Errors
    /// [`ModelError::NoBackend`]: the library is not there; [`ModelError::BadNetwork`]. `path` is for the message only.
    pub fn new(onnx: &[u8], side: u32, threads: usize, path: &Path) -> Result<Self, ModelError> {
        let library = std::env::var_os("ORT_DYLIB_PATH").unwrap_or_else(|| "libonnxruntime.so".into());
        let missing = |error: &dyn std::fmt::Display| ModelError::NoBackend {
            what: format!(
                "{}: {error}; install ONNX Runtime and name its libonnxruntime.so in ORT_DYLIB_PATH",
                library.display()
            ),
        };
        let environment = ort::init_from(&library).map_err(|error| missing(&error))?;
        let environment = environment.build().map_err(|error| missing(&error))?;
        let bad = |error: &dyn std::fmt::Display| ModelError::BadNetwork {
            path: path.to_owned(),
            what: error.to_string(),
        };
        let builder = Session::builder(&environment).map_err(|error| bad(&error))?;
        let builder = builder.with_intra_threads(threads.max(1)).map_err(|error| bad(&error))?;
        let builder =
            builder.with_optimization_level(GraphOptimizationLevel::Level3).map_err(|error| bad(&error))?;
        let mut builder = builder.with_quant_qdq(computes_in_bytes(onnx)).map_err(|error| bad(&error))?;
        let session = builder.commit_from_memory(onnx).map_err(|error| bad(&error))?;
        if session.inputs().len() != 1 || session.outputs().len() != 1 {
            let (inputs, outputs) = (session.inputs().len(), session.outputs().len());
            return Err(bad(&format!("{inputs} inputs and {outputs} outputs; one of each is expected")));
        }
        Ok(Self { session, side: side as usize })
    }
}

/// Does the network compute in bytes, or are only its kernels stored so? In the second case they shall be turned into
/// floats once, while loading. Telling sign: features are made bytes by `QuantizeLinear`; kernels only need
/// `DequantizeLinear`, whose name does not contain the other with its capital letter.
fn computes_in_bytes(onnx: &[u8]) -> bool {
    const SIGN: &[u8] = b"QuantizeLinear";
    onnx.windows(SIGN.len()).any(|window| window == SIGN)
}

impl Rows for OrtNetwork {
    fn infer(&mut self, input: &[f32], rows: &mut Vec<f32>) -> Result<(), Unknown> {
        let failed = |error: ort::Error| Unknown::Failed { what: error.to_string() };
        let tensor = TensorRef::from_array_view(([1, 3, self.side, self.side], input)).map_err(failed)?;
        let outputs = self.session.run(ort::inputs![tensor]).map_err(failed)?;
        let (_, numbers) = outputs[0].try_extract_tensor::<f32>().map_err(failed)?;
        rows.clear();
        rows.extend_from_slice(numbers);
        Ok(())
    }
}
