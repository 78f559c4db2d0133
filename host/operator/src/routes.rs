//! What answers which request.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::header::{self, HeaderName};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::map_response;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use nearfield_recording::folder::is_recording_name;
use nearfield_recording::{Event, Tap};
use nearfield_shared::units::Micros;
use subtle::ConstantTimeEq as _;
use tokio_util::io::ReaderStream;

use crate::board::Board;
use crate::commission::Order;

/// What every request sees.
pub struct Shared {
    /// What is shown.
    pub board: Board,
    /// `/api/about`.
    pub about: Vec<u8>,
    /// Folder of recordings.
    pub recordings: Option<PathBuf>,
    /// Who knows it may leave remarks; `None` = nobody.
    pub token: Option<String>,
    /// Where remarks go.
    pub remarks: Option<Tap>,
    /// Where orders for a commissioning go.
    pub orders: SyncSender<Order>,
    /// The host's clock.
    pub clock: Box<dyn Fn() -> Micros + Send + Sync>,
}

type Known = State<Arc<Shared>>;

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const JSON: &str = "application/json";
/// Bytes and characters of a remark.
const LARGEST_REMARK: usize = 1024;
const LONGEST_REMARK: usize = 200;

/// Nothing from elsewhere, nothing inline, no frames, no forms.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The protocol carries its own style, so that a saved copy prints the same, and nothing else.
const POLICY_OF_PROTOCOL: &str = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The routes.
pub fn routes(shared: Arc<Shared>) -> Router {
    Router::new()
        .route("/", get(|| file(HTML, include_bytes!("../page/index.html"))))
        .route("/page.css", get(|| file("text/css; charset=utf-8", include_bytes!("../page/page.css"))))
        .route("/page.js", get(|| file(SCRIPT, include_bytes!("../page/page.js"))))
        .route("/favicon.svg", get(|| file("image/svg+xml", include_bytes!("../page/favicon.svg"))))
        .route("/api/live", get(live))
        .route("/api/status", get(status))
        .route("/api/about", get(about))
        .route("/api/vda5050", get(vda5050))
        .route("/commission.js", get(|| file(SCRIPT, include_bytes!("../page/commission.js"))))
        .route("/api/commission", get(commission))
        .route("/api/commission/begin", post(begin))
        .route("/api/commission/end", post(end))
        .route("/commission.html", get(protocol))
        .route("/api/mark", post(mark))
        .route("/metrics", get(metrics))
        .route("/picture.jpg", get(picture))
        .route("/recordings/{name}", get(recording))
        .layer(DefaultBodyLimit::max(LARGEST_REMARK))
        .layer(map_response(with_headers))
        .with_state(shared)
}

async fn with_headers(mut response: Response) -> Response {
    let headers = response.headers_mut();
    let fixed: [(HeaderName, &'static str); 5] = [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ];
    for (name, value) in fixed {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}

async fn file(kind: &'static str, bytes: &'static [u8]) -> Response {
    ([(header::CONTENT_TYPE, kind)], bytes).into_response()
}

fn typed(kind: &'static str, bytes: Vec<u8>) -> Response {
    if bytes.is_empty() {
        return (StatusCode::SERVICE_UNAVAILABLE, "nothing was seen yet; come again").into_response();
    }
    ([(header::CONTENT_TYPE, kind)], bytes).into_response()
}

async fn live(State(shared): Known) -> Response {
    typed(JSON, shared.board.newest().live.clone())
}

async fn status(State(shared): Known) -> Response {
    typed(JSON, shared.board.newest().status.clone())
}

async fn about(State(shared): Known) -> Response {
    typed(JSON, shared.about.clone())
}

async fn vda5050(State(shared): Known) -> Response {
    typed(JSON, shared.board.newest().vda5050.clone())
}

async fn commission(State(shared): Known) -> Response {
    typed(JSON, shared.board.newest().commission.clone())
}

async fn protocol(State(shared): Known) -> Response {
    let protocol = shared.board.newest().protocol.clone();
    if protocol.is_empty() {
        return (StatusCode::NOT_FOUND, "nobody has begun a commissioning").into_response();
    }
    let headers = [(header::CONTENT_TYPE, HTML), (header::CONTENT_SECURITY_POLICY, POLICY_OF_PROTOCOL)];
    (headers, protocol).into_response()
}

async fn begin(State(shared): Known, headers: HeaderMap, body: Bytes) -> Response {
    match remark(&body) {
        Some(person) => order(&shared, &headers, Order::Begin(person)),
        None => order_refused(&shared, &headers),
    }
}

async fn end(State(shared): Known, headers: HeaderMap) -> Response {
    order(&shared, &headers, Order::End)
}

/// For those who know the token. The answer to everybody else tells nothing.
fn order(shared: &Shared, headers: &HeaderMap, order: Order) -> Response {
    if !is_authorised(shared.token.as_deref(), headers) {
        return unauthorised("a commissioning needs the token");
    }
    match shared.orders.try_send(order) {
        Ok(()) => StatusCode::NO_CONTENT.into_response(),
        Err(_) => (StatusCode::SERVICE_UNAVAILABLE, "busy; try again").into_response(),
    }
}

fn order_refused(shared: &Shared, headers: &HeaderMap) -> Response {
    if !is_authorised(shared.token.as_deref(), headers) {
        return unauthorised("a commissioning needs the token");
    }
    (StatusCode::BAD_REQUEST, "a name is 1 to 200 characters of text").into_response()
}

fn unauthorised(words: &'static str) -> Response {
    (StatusCode::UNAUTHORIZED, [(header::WWW_AUTHENTICATE, "Bearer")], words).into_response()
}

async fn metrics(State(shared): Known) -> Response {
    typed("text/plain; version=0.0.4; charset=utf-8", shared.board.newest().metrics.clone())
}

async fn picture(State(shared): Known) -> Response {
    match &shared.board.newest().picture {
        Some(picture) => ([(header::CONTENT_TYPE, "image/jpeg")], picture.jpeg.clone()).into_response(),
        None => (StatusCode::NOT_FOUND, "there is no picture yet").into_response(),
    }
}

async fn recording(State(shared): Known, Path(name): Path<String>) -> Response {
    let unknown = || (StatusCode::NOT_FOUND, "there is no such recording").into_response();
    let Some(folder) = shared.recordings.as_ref().filter(|_| is_recording_name(&name)) else {
        return unknown();
    };
    let Ok(file) = tokio::fs::File::open(folder.join(&name)).await else { return unknown() };
    // It may grow while it is sent: what is there is sent.
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{name}\"")),
    ];
    (headers, Body::from_stream(ReaderStream::new(file))).into_response()
}

/// A remark, for those who know the token. The answer to everybody else tells nothing.
async fn mark(State(shared): Known, headers: HeaderMap, body: Bytes) -> Response {
    if !is_authorised(shared.token.as_deref(), &headers) {
        return unauthorised("a remark needs the token");
    }
    let Some(remarks) = &shared.remarks else {
        return (StatusCode::CONFLICT, "nothing is being recorded; set recording.directory").into_response();
    };
    let Some(text) = remark(&body) else {
        return (StatusCode::BAD_REQUEST, "a remark is 1 to 200 characters of text").into_response();
    };
    if remarks.tell((shared.clock)(), Event::Mark(text.into())) {
        StatusCode::NO_CONTENT.into_response()
    } else {
        (StatusCode::SERVICE_UNAVAILABLE, "the recorder is busy; try again").into_response()
    }
}

fn is_authorised(token: Option<&str>, headers: &HeaderMap) -> bool {
    let Some(token) = token else { return false };
    let told = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    let told = told.and_then(|value| value.strip_prefix("Bearer ")).unwrap_or("");
    // The time that this takes does not depend on where the two differ.
    !token.is_empty() && bool::from(told.as_bytes().ct_eq(token.as_bytes()))
}

/// Printable text only: it ends up in logs.
fn remark(body: &[u8]) -> Option<String> {
    let text = std::str::from_utf8(body).ok()?.trim();
    let sound =
        !text.is_empty() && text.chars().count() <= LONGEST_REMARK && !text.chars().any(char::is_control);
    sound.then(|| text.to_owned())
}
