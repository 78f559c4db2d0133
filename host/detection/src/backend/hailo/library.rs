//! HailoRT's C interface: the only unsafe code of this crate, behind a safe session.
//!
//! Functions and structures are those of HailoRT 4.23's `hailort.h` on 64-bit Linux. The order of calls is fixed by
//! [`Session::open`]: device, HEF, configuration, parameters of the streams, streams. [`Session::drop`] goes the other
//! way. With default parameters HailoRT schedules networks itself, so that nothing needs to be activated.
#![allow(unsafe_code, reason = "calls into a C library; every block says why it is sound")]

use std::ffi::{CString, c_char, c_void};
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::ptr;

use libloading::{Library, Symbol};
use thiserror::Error;

/// HailoRT's status "everything went well".
const SUCCESS: Status = 0;
/// HailoRT's status "time-out".
const TIMED_OUT: Status = 4;
/// The major version whose structures these are.
const MAJOR_VERSION: u32 = 4;
/// Format type: unsigned bytes.
const BYTES: u32 = 1;
/// Format type: 32-bit floats.
const FLOATS: u32 = 3;
/// Format order: suppressed boxes, class by class.
const NMS_BY_CLASS: u32 = 22;
/// Room for network groups and streams in the calls that fill lists.
const ROOM: usize = 8;

type Status = u32;
type Handle = *mut c_void;

/// `hailo_format_t`.
#[repr(C)]
#[derive(Clone, Copy)]
struct Format {
    kind: u32,
    order: u32,
    flags: u32,
}

/// `hailo_vstream_params_t`.
#[repr(C)]
#[derive(Clone, Copy)]
struct StreamParameters {
    format: Format,
    timeout_ms: u32,
    queue_size: u32,
    stream_statistics: u32,
    element_statistics: u32,
}

/// `hailo_input_vstream_params_by_name_t`, and the same for outputs.
#[repr(C)]
#[derive(Clone, Copy)]
struct NamedParameters {
    name: [c_char; 128],
    parameters: StreamParameters,
}

/// `hailo_vstream_info_t`; for suppressed boxes `shape` is classes, most boxes a class, and two that are not used.
#[repr(C)]
#[derive(Clone, Copy)]
struct StreamInfo {
    name: [c_char; 128],
    network_name: [c_char; 257],
    direction: u32,
    format: Format,
    shape: [u32; 4],
    quantisation: [f32; 4],
}

// The sizes and places in the C header on 64-bit Linux: a structure that grew by mistake must not compile.
const _: () = assert!(size_of::<NamedParameters>() == 156 && size_of::<StreamInfo>() == 436);
const _: () = assert!(core::mem::offset_of!(StreamInfo, format) == 392);
const _: () = assert!(core::mem::offset_of!(StreamInfo, shape) == 404);

/// Why HailoRT is of no use.
#[derive(Debug, Error)]
pub enum Failure {
    /// The library cannot be opened, or is another one.
    #[error("{0}")]
    NoLibrary(String),
    /// A call came back with an error.
    #[error("{call} failed with HailoRT's status {status}")]
    Call {
        /// Which.
        call: &'static str,
        /// HailoRT's number for it.
        status: Status,
    },
    /// No answer in time.
    #[error("no answer in time")]
    TimedOut,
    /// The network is not what is needed.
    #[error("{0}")]
    Unfit(String),
}

/// What a network takes and gives.
#[derive(Debug, Clone, Copy)]
pub struct Shape {
    /// Bytes of a picture.
    pub input_bytes: usize,
    /// Floats of an answer.
    pub output_numbers: usize,
    /// Classes.
    pub classes: usize,
    /// Most boxes of a class.
    pub most_a_class: usize,
}

type Make = unsafe extern "C" fn(Handle, bool, u32, *mut NamedParameters, *mut usize) -> Status;
type Create = unsafe extern "C" fn(Handle, *const NamedParameters, usize, *mut Handle) -> Status;
type FrameSize = unsafe extern "C" fn(Handle, *mut usize) -> Status;
type ReleaseStreams = unsafe extern "C" fn(*const Handle, usize) -> Status;
type Release = unsafe extern "C" fn(Handle) -> Status;
type Write = unsafe extern "C" fn(Handle, *const c_void, usize) -> Status;
type Read = unsafe extern "C" fn(Handle, *mut c_void, usize) -> Status;

/// An open device with one network and its two streams.
pub struct Session {
    device: Handle,
    hef: Handle,
    input: Handle,
    output: Handle,
    shape: Shape,
    write: Write,
    read: Read,
    release_inputs: ReleaseStreams,
    release_outputs: ReleaseStreams,
    release_hef: Release,
    release_device: Release,
    /// Last: the functions above live in it.
    _library: Library,
}

// SAFETY: the handles are used through `&mut self` only, so by one thread at a time, and HailoRT does not bind them to
// the thread that made them (its streams have threads of their own).
unsafe impl Send for Session {}

/// A function of the library, copied out of it.
///
/// # Safety
/// `T` must be the function's true type, and the pointer must not outlive the library.
unsafe fn function<T: Copy>(library: &Library, name: &'static str) -> Result<T, Failure> {
    // SAFETY: passed on to the caller.
    let symbol: Symbol<'_, T> = unsafe { library.get(name.as_bytes()) }
        .map_err(|error| Failure::NoLibrary(format!("it has no {name}: {error}")))?;
    Ok(*symbol)
}

fn check(call: &'static str, status: Status) -> Result<(), Failure> {
    match status {
        SUCCESS => Ok(()),
        TIMED_OUT => Err(Failure::TimedOut),
        status => Err(Failure::Call { call, status }),
    }
}

impl Session {
    /// Opens library, device and HEF, up to running streams.
    pub fn open(library: &Path, hef: &Path, timeout_ms: u32) -> Result<Self, Failure> {
        // SAFETY: HailoRT's library has no initialisers that depend on us; a file under its name is trusted as such.
        let library =
            unsafe { Library::new(library) }.map_err(|error| Failure::NoLibrary(error.to_string()))?;
        check_version(&library)?;
        // SAFETY: the types are those of hailort.h, and the library moves into the session with the pointers.
        let mut session = unsafe {
            Self {
                device: ptr::null_mut(),
                hef: ptr::null_mut(),
                input: ptr::null_mut(),
                output: ptr::null_mut(),
                shape: Shape { input_bytes: 0, output_numbers: 0, classes: 0, most_a_class: 0 },
                write: function(&library, "hailo_vstream_write_raw_buffer")?,
                read: function(&library, "hailo_vstream_read_raw_buffer")?,
                release_inputs: function(&library, "hailo_release_input_vstreams")?,
                release_outputs: function(&library, "hailo_release_output_vstreams")?,
                release_hef: function(&library, "hailo_release_hef")?,
                release_device: function(&library, "hailo_release_vdevice")?,
                _library: library,
            }
        };
        let group = session.configure(hef)?;
        session.create_streams(group, timeout_ms)?;
        session.shape = session.ask_shape()?;
        Ok(session)
    }

    /// Device, HEF, and the HEF's one network group.
    fn configure(&mut self, hef: &Path) -> Result<Handle, Failure> {
        type CreateDevice = unsafe extern "C" fn(*mut c_void, *mut Handle) -> Status;
        type CreateHef = unsafe extern "C" fn(*mut Handle, *const c_char) -> Status;
        type Configure = unsafe extern "C" fn(Handle, Handle, *mut c_void, *mut Handle, *mut usize) -> Status;
        let path = CString::new(hef.as_os_str().as_bytes())
            .map_err(|_| Failure::Unfit("its name has a zero byte".to_owned()))?;
        let mut groups = [ptr::null_mut(); ROOM];
        let mut count = ROOM;
        // SAFETY: true types; every pointer is to a live local or field, lists have the room that is told, and null
        // parameters mean defaults.
        unsafe {
            let create_device: CreateDevice = function(&self._library, "hailo_create_vdevice")?;
            check("hailo_create_vdevice", create_device(ptr::null_mut(), &raw mut self.device))?;
            let create_hef: CreateHef = function(&self._library, "hailo_create_hef_file")?;
            check("hailo_create_hef_file", create_hef(&raw mut self.hef, path.as_ptr()))?;
            let configure: Configure = function(&self._library, "hailo_configure_vdevice")?;
            let status =
                configure(self.device, self.hef, ptr::null_mut(), groups.as_mut_ptr(), &raw mut count);
            check("hailo_configure_vdevice", status)?;
        }
        match count {
            1 => Ok(groups[0]),
            other => Err(Failure::Unfit(format!("{other} network groups; one is expected"))),
        }
    }

    /// One stream of bytes in, one of floats out.
    fn create_streams(&mut self, group: Handle, timeout_ms: u32) -> Result<(), Failure> {
        let input = self.parameters("hailo_make_input_vstream_params", group, BYTES, timeout_ms)?;
        let output = self.parameters("hailo_make_output_vstream_params", group, FLOATS, timeout_ms)?;
        // SAFETY: true types; one parameter structure and room for one handle each, as told.
        unsafe {
            let create: Create = function(&self._library, "hailo_create_input_vstreams")?;
            check("hailo_create_input_vstreams", create(group, &raw const input, 1, &raw mut self.input))?;
            let create: Create = function(&self._library, "hailo_create_output_vstreams")?;
            check("hailo_create_output_vstreams", create(group, &raw const output, 1, &raw mut self.output))
        }
    }

    /// Default parameters of the only stream in one direction.
    fn parameters(
        &self,
        name: &'static str,
        group: Handle,
        format: u32,
        timeout_ms: u32,
    ) -> Result<NamedParameters, Failure> {
        let empty = NamedParameters {
            name: [0; 128],
            parameters: StreamParameters {
                format: Format { kind: 0, order: 0, flags: 0 },
                timeout_ms: 0,
                queue_size: 0,
                stream_statistics: 0,
                element_statistics: 0,
            },
        };
        let mut list = [empty; ROOM];
        let mut count = ROOM;
        // SAFETY: true type; the list has the room that is told. The second argument is not used by HailoRT.
        unsafe {
            let make: Make = function(&self._library, name)?;
            check(name, make(group, false, format, list.as_mut_ptr(), &raw mut count))?;
        }
        if count != 1 {
            return Err(Failure::Unfit(format!("{count} streams in one direction; one is expected")));
        }
        list[0].parameters.timeout_ms = timeout_ms;
        Ok(list[0])
    }

    fn ask_shape(&self) -> Result<Shape, Failure> {
        type Describe = unsafe extern "C" fn(Handle, *mut StreamInfo) -> Status;
        let format = Format { kind: 0, order: 0, flags: 0 };
        let (shape, quantisation) = ([0; 4], [0.0; 4]);
        let (name, network_name) = ([0; 128], [0; 257]);
        let mut info = StreamInfo { name, network_name, direction: 0, format, shape, quantisation };
        let (mut input_bytes, mut output_bytes) = (0usize, 0usize);
        // SAFETY: true types; the streams are open, and every pointer is to a live local.
        unsafe {
            let describe: Describe = function(&self._library, "hailo_get_output_vstream_info")?;
            check("hailo_get_output_vstream_info", describe(self.output, &raw mut info))?;
            let size: FrameSize = function(&self._library, "hailo_get_input_vstream_frame_size")?;
            check("hailo_get_input_vstream_frame_size", size(self.input, &raw mut input_bytes))?;
            let size: FrameSize = function(&self._library, "hailo_get_output_vstream_frame_size")?;
            check("hailo_get_output_vstream_frame_size", size(self.output, &raw mut output_bytes))?;
        }
        if info.format.order != NMS_BY_CLASS {
            let order = info.format.order;
            return Err(Failure::Unfit(format!(
                "its output has order {order}, not suppressed boxes by class"
            )));
        }
        let [classes, most_a_class, ..] = info.shape.map(|value| value as usize);
        Ok(Shape { input_bytes, output_numbers: output_bytes / size_of::<f32>(), classes, most_a_class })
    }

    /// What the network takes and gives.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// A picture in, numbers out; both as long as [`Session::shape`] says.
    pub fn exchange(&mut self, input: &[u8], output: &mut [f32]) -> Result<(), Failure> {
        if input.len() != self.shape.input_bytes || output.len() != self.shape.output_numbers {
            return Err(Failure::Unfit("buffers of another size than the network's".to_owned()));
        }
        // SAFETY: the streams are open; both buffers are live and as long as told, and any bytes make valid floats.
        unsafe {
            check("writing a picture", (self.write)(self.input, input.as_ptr().cast(), input.len()))?;
            let bytes = size_of_val(output);
            check("reading the answer", (self.read)(self.output, output.as_mut_ptr().cast(), bytes))
        }
    }
}

fn check_version(library: &Library) -> Result<(), Failure> {
    type Version = unsafe extern "C" fn(*mut u32) -> Status;
    let mut version = [0u32; 3];
    // SAFETY: true type; `hailo_version_t` is three 32-bit numbers.
    unsafe {
        let ask: Version = function(library, "hailo_get_library_version")?;
        check("hailo_get_library_version", ask(version.as_mut_ptr()))?;
    }
    let [major, minor, revision] = version;
    if major == MAJOR_VERSION {
        return Ok(());
    }
    Err(Failure::NoLibrary(format!(
        "it is HailoRT {major}.{minor}.{revision}; the Hailo-8L needs version {MAJOR_VERSION}"
    )))
}

impl Drop for Session {
    fn drop(&mut self) {
        // Errors are of no use here: the device is given up either way.
        // SAFETY: every handle that is not null is open, is released once, and the streams before what they stand on.
        unsafe {
            if !self.input.is_null() {
                (self.release_inputs)(&raw const self.input, 1);
            }
            if !self.output.is_null() {
                (self.release_outputs)(&raw const self.output, 1);
            }
            if !self.hef.is_null() {
                (self.release_hef)(self.hef);
            }
            if !self.device.is_null() {
                (self.release_device)(self.device);
            }
        }
    }
}
