//! Service requests and their answers on the wire.
