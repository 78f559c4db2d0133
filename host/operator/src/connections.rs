//! Takes connections, no more than a fixed number at a time, each for a bounded time.

use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::AsyncWriteExt as _;
use tokio::sync::{Notify, Semaphore};

/// At a time; more are told to come again.
pub const MOST_CONNECTIONS: usize = 64;
/// A client that has not sent its request by then is not waited for.
const LONGEST_HEAD: Duration = Duration::from_secs(5);
/// The longest life of a connection: nobody holds a place for ever, a recording is fetched within it.
const LONGEST_CONNECTION: Duration = Duration::from_secs(30);
/// Bytes of a request's head.
const LARGEST_HEAD: usize = 16 * 1024;

const COME_AGAIN: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 2\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";

/// Until `end` is notified.
///
/// # Errors
/// The listener cannot be used.
pub async fn serve(listener: TcpListener, router: Router, end: Arc<Notify>) -> std::io::Result<()> {
    listener.set_nonblocking(true)?;
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let places = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = end.notified() => return Ok(()),
        };
        let Ok((mut stream, _)) = accepted else {
            // Out of file descriptors, for instance: others must end first.
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        // Small answers at once; a socket that refuses works all the same.
        let _ = stream.set_nodelay(true);
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else {
            tokio::spawn(async move {
                // Told if that is possible at once; gone in any case.
                let _ = tokio::time::timeout(Duration::from_millis(200), stream.write_all(COME_AGAIN)).await;
            });
            continue;
        };
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let mut builder = http1::Builder::new();
            builder.timer(TokioTimer::new()).header_read_timeout(LONGEST_HEAD).max_buf_size(LARGEST_HEAD);
            // A client that has said all it wants to say still gets its answer.
            builder.half_close(true);
            let connection = builder.serve_connection(TokioIo::new(stream), service);
            // However it ends: the client's affair.
            let _ = tokio::time::timeout(LONGEST_CONNECTION, connection).await;
            drop(place);
        });
    }
}
