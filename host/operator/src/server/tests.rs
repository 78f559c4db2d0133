#![allow(clippy::unwrap_used)]

use std::io::{Read as _, Write as _};
use std::net::TcpStream;

use nearfield_recording::queue::Next;
use nearfield_recording::{Event, queue};
use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::laser::Laser;
use nearfield_shared::rig::{ImageSize, Rig, Stripe};
use proptest::prelude::*;

use super::*;
use crate::connections::MOST_CONNECTIONS;
use crate::tally::Tally;

const TOKEN: &str = "0123456789abcdef0123";

/// A page on a free port, with a folder of recordings and a token.
struct Bench {
    place: tempfile::TempDir,
    page: Page,
    remarks: Drain,
}

impl Bench {
    fn new() -> Self {
        let place = tempfile::tempdir().unwrap();
        std::fs::write(place.path().join("token"), format!("{TOKEN}\n")).unwrap();
        std::fs::write(place.path().join("front-20260101T000000Z-0000.mcap"), b"a recording").unwrap();
        let (tap, remarks) = queue(64);
        let settings = Settings {
            listen: "127.0.0.1:0".parse().unwrap(),
            token_file: Some(place.path().join("token")),
            recordings: Some(place.path().to_path_buf()),
            remarks: Some(tap),
            about: About { module: "front".to_owned(), ..About::default() },
            clock: Box::new(|| Micros::new(7)),
        };
        let model = Model::new("front", 0, &rig(), Arc::new(Tally::default()), None).unwrap();
        let model = model.with_commissioning(crate::commission::tests::plan());
        let (_, drain) = queue(1);
        let page = Page::start(settings, model, drain).unwrap();
        let bench = Self { place, page, remarks };
        bench.wait_for_the_first_view();
        bench
    }

    fn wait_for_the_first_view(&self) {
        let begun = Instant::now();
        while !self
            .ask("GET /api/status HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n")
            .starts_with("HTTP/1.1 200")
        {
            assert!(begun.elapsed() < Duration::from_secs(60), "nothing is published");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.page.address()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    /// Everything that comes back, as far as it is text.
    fn ask(&self, request: &str) -> String {
        self.ask_bytes(request.as_bytes())
    }

    fn ask_bytes(&self, request: &[u8]) -> String {
        let mut stream = self.connect();
        // The server may hang up on nonsense before it has all of it.
        let _ = stream.write_all(request);
        let _ = stream.shutdown(std::net::Shutdown::Write);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    fn get(&self, path: &str) -> String {
        self.ask(&format!("GET {path} HTTP/1.1\r\nHost: robot\r\nConnection: close\r\n\r\n"))
    }

    fn post(&self, path: &str, headers: &str, body: &str) -> String {
        let length = body.len();
        self.ask(&format!(
            "POST {path} HTTP/1.1\r\nHost: robot\r\nConnection: close\r\n{headers}Content-Length: {length}\r\n\r\n{body}"
        ))
    }

    fn told(&self) -> Vec<Event> {
        let mut told = Vec::new();
        while let Next::Event(stamped) = self.remarks.next() {
            told.push(stamped.event);
        }
        told
    }
}

/// The rig of the repository's README, without distortion.
pub fn rig() -> Rig {
    let (sin, cos) = 40_f64.to_radians().sin_cos();
    let rotation = [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, -cos, -sin), Vector::new(0.0, sin, -cos)];
    let translation = Pose { rotation, translation: Vector::default() }
        .to_camera(Vector::new(0.0, 0.0, 400.0))
        .scaled(-1.0);
    let intrinsics = Intrinsics { fx: 1792.0, fy: 1792.0, cx: 1151.5, cy: 647.5, distortion: [0.0; 5] };
    let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
    let (origin, point) = (Vector::new(0.0, 0.0, 200.0), Vector::new(0.0, 500.0, 0.0));
    let direction = Vector::new(1.0, 0.0, 0.0);
    let normal = direction.cross(origin.minus(point));
    let normal = normal.scaled(1.0 / normal.dot(normal).sqrt());
    let laser = Laser { origin, normal, offset: normal.dot(origin) };
    let stripe = Stripe { point, direction, start: -300.0, end: 300.0 };
    Rig::new(ImageSize { width: 2304, height: 1296 }, camera, laser, stripe).unwrap()
}

fn status_of(answer: &str) -> &str {
    answer.split_whitespace().nth(1).unwrap_or("")
}

#[test]
fn everything_that_is_shown_is_there_with_a_policy_that_lets_nothing_else_in() {
    let bench = Bench::new();
    for (path, kind, content) in [
        ("/", "text/html", "<main>"),
        ("/page.css", "text/css", "prefers-color-scheme"),
        ("/page.js", "text/javascript", "use strict"),
        ("/favicon.svg", "image/svg+xml", "<svg"),
        ("/api/live", "application/json", "\"profile\""),
        ("/api/status", "application/json", "\"relay\":\"unknown\""),
        ("/api/about", "application/json", "\"takes_remarks\":true"),
        ("/api/vda5050", "application/json", "\"eStop\":\"MANUAL\""),
        ("/metrics", "text/plain", "nearfield_build_info{module=\"front\""),
        ("/recordings/front-20260101T000000Z-0000.mcap", "application/octet-stream", "a recording"),
    ] {
        let answer = bench.get(path);
        assert_eq!(status_of(&answer), "200", "{path}: {answer}");
        assert!(answer.contains(kind) && answer.contains(content), "{path}: {answer}");
        assert!(answer.contains("content-security-policy: default-src 'none'"), "{path}");
        assert!(answer.contains("x-content-type-options: nosniff"), "{path}");
    }
    assert_eq!(status_of(&bench.get("/picture.jpg")), "404", "there is none yet");
    // The page asks nobody else for anything.
    for file in [
        include_str!("../../page/index.html"),
        include_str!("../../page/page.css"),
        include_str!("../../page/page.js"),
    ] {
        let elsewhere =
            file.replace("http://www.w3.org/2000/svg", "").contains("//www.") || file.contains("https:");
        assert!(!elsewhere && !file.contains("style=\"") && !file.contains("onclick"));
    }
}

#[test]
fn only_recordings_are_handed_out() {
    let bench = Bench::new();
    for name in
        ["token", "..%2ftoken", "%2e%2e/token", "../token", "nothing-there.mcap", "a%00.mcap", "%ff.mcap", ""]
    {
        let answer = bench.get(&format!("/recordings/{name}"));
        assert!(["400", "404"].contains(&status_of(&answer)), "{name}: {answer}");
        assert!(!answer.contains(TOKEN), "{name}");
    }
}

#[test]
fn a_remark_needs_the_token_and_nothing_else_is_ever_changed() {
    let bench = Bench::new();
    let right = format!("Authorization: Bearer {TOKEN}\r\n");
    for headers in [
        String::new(),
        "Authorization: Bearer \r\n".to_owned(),
        "Authorization: Bearer 0123456789abcdef0124\r\n".to_owned(),
        format!("Authorization: Bearer {}\r\n", &TOKEN[..19]),
        format!("Authorization: Bearer {TOKEN}0\r\n"),
        format!("Authorization: Basic {TOKEN}\r\n"),
        format!("Authorization: {TOKEN}\r\n"),
        format!("Cookie: token={TOKEN}\r\n"),
    ] {
        assert_eq!(status_of(&bench.post("/api/mark", &headers, "hello")), "401", "{headers}");
    }
    assert_eq!(bench.told(), []);
    for body in ["", "   ", "a\u{7}b", &"x".repeat(201)] {
        assert_eq!(status_of(&bench.post("/api/mark", &right, body)), "400");
    }
    assert_eq!(status_of(&bench.post("/api/mark", &right, &"x".repeat(5000))), "413");
    assert_eq!(bench.told(), []);
    assert_eq!(status_of(&bench.post("/api/mark", &right, " a cable lay here ")), "204");
    assert_eq!(bench.told(), [Event::Mark("a cable lay here".into())]);
}

#[test]
fn without_a_token_nobody_may_leave_remarks_and_a_weak_one_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let weak = place.path().join("weak");
    std::fs::write(&weak, "secret").unwrap();
    let start = |token_file: Option<PathBuf>| {
        let settings = Settings {
            listen: "127.0.0.1:0".parse().unwrap(),
            token_file,
            recordings: None,
            remarks: Some(queue(1).0),
            about: About::default(),
            clock: Box::new(|| Micros::ZERO),
        };
        Page::start(settings, Model::new("front", 0, &rig(), Arc::default(), None).unwrap(), queue(1).1)
    };
    assert!(start(Some(weak)).err().unwrap().to_string().contains("openssl rand"));
    let missing = start(Some(place.path().join("none"))).err().unwrap().to_string();
    assert!(missing.contains("page.token_file"), "{missing}");
    let page = start(None).unwrap();
    let mut stream = TcpStream::connect(page.address()).unwrap();
    let request = "POST /api/mark HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer \r\nConnection: close\r\nContent-Length: 2\r\n\r\nhi";
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert_eq!(status_of(&answer), "401");
}

#[test]
fn a_port_that_is_taken_is_told_with_what_to_do() {
    let bench = Bench::new();
    let settings = Settings {
        listen: bench.page.address(),
        token_file: None,
        recordings: None,
        remarks: None,
        about: About::default(),
        clock: Box::new(|| Micros::ZERO),
    };
    let model = Model::new("front", 0, &rig(), Arc::default(), None).unwrap();
    let told = Page::start(settings, model, queue(1).1).err().unwrap().to_string();
    assert!(told.contains("change page.listen"), "{told}");
    drop(bench.place);
}

/// Clients that connect and say nothing take no more than their places, and those who come then are told so.
#[test]
fn a_flood_is_turned_away_and_the_page_comes_back() {
    let bench = Bench::new();
    let mut silent: Vec<TcpStream> = (0..MOST_CONNECTIONS + 20).map(|_| bench.connect()).collect();
    let mut turned_away = 0;
    for stream in &mut silent[MOST_CONNECTIONS..] {
        let mut answer = String::new();
        // A connection that is reset was turned away, too.
        let _ = stream.read_to_string(&mut answer);
        turned_away += u32::from(answer.is_empty() || answer.starts_with("HTTP/1.1 503"));
    }
    assert_eq!(turned_away, 20);
    drop(silent);
    let begun = Instant::now();
    while status_of(&bench.get("/api/status")) != "200" {
        assert!(begun.elapsed() < Duration::from_secs(60), "the page does not come back");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]
    /// Whatever bytes come, the next visitor is served, and no remark was taken. Many requests a case: a page is dear to start.
    #[test]
    fn no_bytes_break_the_server_or_change_anything(
        requests in prop::collection::vec(
            prop_oneof![
                prop::collection::vec(any::<u8>(), 0..200),
                ("(GET|POST|PUT|DELETE|HEAD|OPTIONS|[A-Z]{1,8})", "/[a-zA-Z0-9/%._?=-]{0,60}", "[ -~]{0,80}", "[ -~]{0,80}")
                    .prop_map(|(method, path, header, body)| {
                        format!("{method} {path} HTTP/1.1\r\nHost: a\r\nX: {header}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}", body.len())
                            .into_bytes()
                    }),
                "Bearer [0-9a-f]{0,40}".prop_map(|value| {
                    format!("POST /api/mark HTTP/1.1\r\nHost: a\r\nAuthorization: {value}\r\nContent-Length: 2\r\nConnection: close\r\n\r\nhi")
                        .into_bytes()
                }),
            ],
            30,
        )
    ) {
        let bench = Bench::new();
        for request in &requests {
            let answer = bench.ask_bytes(request);
            prop_assert!(!answer.starts_with("HTTP/1.1 204") && !answer.contains(TOKEN));
        }
        let page = bench.get("/");
        prop_assert_eq!(status_of(&page), "200");
        prop_assert!(bench.told().is_empty());
    }
}

/// A remark as it must be, then changed a little: only what still carries the whole token is taken.
#[derive(Debug, Clone)]
enum Change {
    /// A byte of the request becomes another one.
    Byte(usize, u8),
    /// It ends early.
    Cut(usize),
    /// A piece comes twice.
    Repeat(usize, usize),
    /// Another method, path or header.
    Line(&'static str, &'static str),
}

fn change() -> impl Strategy<Value = Change> {
    prop_oneof![
        4 => (any::<usize>(), any::<u8>()).prop_map(|(at, byte)| Change::Byte(at, byte)),
        1 => any::<usize>().prop_map(Change::Cut),
        1 => (any::<usize>(), 1..40_usize).prop_map(|(at, length)| Change::Repeat(at, length)),
        2 => prop::sample::select(vec![
            ("POST", "GET"),
            ("POST", "PUT"),
            ("/api/mark", "/api/mark/"),
            ("/api/mark", "//api/mark"),
            ("/api/mark", "/api/status"),
            ("Bearer ", "bearer "),
            ("Bearer ", "Bearer  "),
            ("Authorization", "X-Authorization"),
            ("Content-Length: 5", "Transfer-Encoding: chunked"),
            ("Content-Length: 5", "Content-Length: 5\r\nContent-Length: 6"),
            ("Host: robot", "Host: robot\r\nX-HTTP-Method-Override: DELETE"),
        ]).prop_map(|(from, to)| Change::Line(from, to)),
    ]
}

fn changed(mut request: Vec<u8>, change: &Change) -> Vec<u8> {
    match change {
        Change::Byte(at, byte) => {
            let place = at % request.len().max(1);
            if let Some(there) = request.get_mut(place) {
                *there = *byte;
            }
        }
        Change::Cut(at) => request.truncate(at % (request.len() + 1)),
        Change::Repeat(at, length) => {
            let start = at % (request.len() + 1);
            let end = (start + length).min(request.len());
            let piece = request[start..end].to_vec();
            request.splice(start..start, piece);
        }
        Change::Line(from, to) => {
            if let Ok(text) = std::str::from_utf8(&request) {
                request = text.replacen(from, to, 1).into_bytes();
            }
        }
    }
    request
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn a_changed_request_is_taken_with_the_whole_token_only(
        changes in prop::collection::vec(prop::collection::vec(change(), 1..4), 40),
    ) {
        let bench = Bench::new();
        let remark = format!(
            "POST /api/mark HTTP/1.1\r\nHost: robot\r\nAuthorization: Bearer {TOKEN}\r\nContent-Length: 5\r\n\
             Connection: close\r\n\r\nhello"
        );
        for changes in &changes {
            let request = changes.iter().fold(remark.clone().into_bytes(), changed);
            let carries = request.windows(TOKEN.len()).any(|piece| piece == TOKEN.as_bytes());
            let answer = bench.ask_bytes(&request);
            let told = bench.told();
            prop_assert!(told.is_empty() || carries, "{:?} was taken: {}", told, String::from_utf8_lossy(&request));
            prop_assert!(!answer.contains(TOKEN), "the token is told: {answer}");
        }
        let answer = bench.post("/api/mark", &format!("Authorization: Bearer {TOKEN}\r\n"), "hello");
        prop_assert_eq!(status_of(&answer), "204");
        prop_assert_eq!(bench.told().len(), 1);
    }
}

/// Until the page's thread has obeyed.
fn commission_becomes(bench: &Bench, running: bool) -> serde_json::Value {
    let begun = Instant::now();
    loop {
        let answer = bench.get("/api/commission");
        let body = answer.split_once("\r\n\r\n").unwrap().1;
        let view: serde_json::Value = serde_json::from_str(body).unwrap();
        if view["running"] == running {
            return view;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{view}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_commissioning_is_seen_by_all_and_begun_by_who_knows_the_token() {
    let bench = Bench::new();
    let answer = bench.get("/commission.html");
    assert_eq!(status_of(&answer), "404", "nobody has begun");
    let wrong = format!("{}x", &TOKEN[1..]);
    for headers in
        ["".to_owned(), format!("Authorization: Bearer {wrong}\r\n"), "Authorization: Bearer\r\n".to_owned()]
    {
        for (path, body) in [("begin", "A. Name"), ("begin", ""), ("end", "")] {
            let answer = bench.post(&format!("/api/commission/{path}"), &headers, body);
            assert_eq!(status_of(&answer), "401", "{headers}{path}");
        }
    }
    std::thread::sleep(3 * PUBLISH_INTERVAL);
    assert_eq!(commission_becomes(&bench, false)["has_protocol"], false, "nothing was changed");
    let known = format!("Authorization: Bearer {TOKEN}\r\n");
    assert_eq!(status_of(&bench.post("/api/commission/begin", &known, "a\u{7}b")), "400");
    assert_eq!(status_of(&bench.post("/api/commission/begin", &known, "A. <Name>")), "204");
    let view = commission_becomes(&bench, true);
    assert_eq!((&view["person"], &view["steps"][2]["standing"]), (&"A. <Name>".into(), &"now".into()));
    assert_eq!(status_of(&bench.post("/api/commission/end", &known, "")), "204");
    commission_becomes(&bench, false);
    let protocol = bench.get("/commission.html");
    assert_eq!(status_of(&protocol), "200");
    assert!(protocol.contains("A. &lt;Name&gt;") && protocol.contains("NOT passed"), "{protocol}");
    let policies = protocol.lines().filter(|line| line.to_lowercase().starts_with("content-security-policy"));
    assert_eq!(policies.collect::<Vec<_>>().len(), 1);
    assert!(protocol.contains("default-src 'none'") && !protocol.contains("<script"), "{protocol}");
    assert!(bench.told().is_empty(), "nothing of it goes anywhere else");
}
