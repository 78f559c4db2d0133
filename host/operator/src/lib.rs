//! What people and programs see of a running sensor: a page, a JSON status, Prometheus metrics, VDA 5050's safety state.
//!
//! ```text
//! stripe path --Tap (never waits)--> queue --> model's thread --ten times a second--> view, as bytes
//!                                                                                       |
//!                         server's thread: at most 64 connections, each for 30 s <------+
//! ```
//!
//! * Nothing here has a way to the controller: the server reads bytes that are ready, and what it takes, a remark for the
//!   recording and the beginning of a commissioning, needs the token. **No request can close a relay, or open one.**
//! * Both threads step back behind everybody else; however many clients come, the stripe's path does not notice.
//! * The page is three files in the program: no build step, no other host, works offline and on a phone.
//!
//! | path | what |
//! |---|---|
//! | `/` | the page |
//! | `/api/live` | everything that the page shows, JSON |
//! | `/api/status` | the same without profile and picture's overlay, for programs |
//! | `/api/about` | what does not change: module, response time, capability |
//! | `/api/vda5050` | `safetyState` and `errors` of a VDA 5050 state message |
//! | `/metrics` | Prometheus' text format |
//! | `/picture.jpg` | the newest picture |
//! | `/recordings/NAME` | a recording, as an MCAP file |
//! | `/api/commission`, `/commission.html` | how far a commissioning is, JSON; its protocol, to print |
//! | `POST /api/commission/begin`, `.../end` | begins one, as the person whose name is sent; ends it; both with the token |
//! | `POST /api/mark` | a remark into the recording, with `Authorization: Bearer TOKEN` |

pub mod about;
pub mod board;
pub mod commission;
mod connections;
pub mod metrics;
pub mod model;
mod routes;
pub mod server;
pub mod tally;
pub mod vda5050;
pub mod view;

pub use about::About;
pub use server::{Page, PageError, Settings};
pub use tally::Tally;
