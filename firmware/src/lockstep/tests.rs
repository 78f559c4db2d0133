use super::*;

fn headers() -> Vec<RequestHeader> {
    let now = Micros::new(0x0102_0304_0506_0708);
    let mut all = vec![
        RequestHeader { request: Request::Start, now, payload_length: 160 },
        RequestHeader { request: Request::Exchange, now, payload_length: 4096 },
        RequestHeader { request: Request::Exchange, now, payload_length: 0 },
        RequestHeader { request: Request::Hang, now, payload_length: 0 },
        RequestHeader { request: Request::Page, now, payload_length: 0 },
    ];
    let self_tests = [SimulatedSelfTest::Passed, SimulatedSelfTest::Pending];
    let failed = SelfTestKind::ALL.map(SimulatedSelfTest::Failed);
    for bits in 0..64 {
        for pulse in [0, 1, 3, 5, 7, 9, 11, 13, 15].map(|bits| pulse_from_bits(bits).unwrap()) {
            let pins = PinInputs { pulse, ..pins_from_bits(bits) };
            let tick = SimulatedTick { pins, self_test: SimulatedSelfTest::Passed };
            all.push(RequestHeader { request: Request::Tick(tick), now, payload_length: 0 });
        }
    }
    for self_test in self_tests.into_iter().chain(failed) {
        let tick = SimulatedTick { pins: PinInputs::default(), self_test };
        all.push(RequestHeader { request: Request::Tick(tick), now, payload_length: 0 });
    }
    all
}

#[test]
fn what_was_asked_is_what_is_read() {
    for header in headers() {
        assert_eq!(RequestHeader::parse(&header.to_bytes()), Ok(header));
    }
}

#[test]
fn golden_bytes_of_a_tick() {
    let pins = PinInputs {
        mirror: MirrorContacts { a: false, b: true },
        reset_pressed: true,
        service_key: true,
        coils: Channels { a: true, b: false },
        pulse: Some(PulseReadback { channel: Channel::B, coils: Channels { a: true, b: false } }),
    };
    let tick = SimulatedTick { pins, self_test: SimulatedSelfTest::Failed(SelfTestKind::Clock) };
    let header = RequestHeader { request: Request::Tick(tick), now: Micros::new(0x0102), payload_length: 0 };
    assert_eq!(header.to_bytes(), [2, 0x1E, 0, 0, 0x07, 0x66, 0, 0, 2, 1, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn malformed_requests_are_refused() {
    let with = |offset: usize, value: u8| {
        let mut bytes = headers()[2].to_bytes();
        bytes[offset] = value;
        RequestHeader::parse(&bytes)
    };
    assert!(with(2, 1).is_ok());
    for (offset, value) in [(0, 0), (0, 6), (1, 1), (3, 17), (4, 1), (5, 1), (6, 1), (7, 1)] {
        assert_eq!(with(offset, value), Err(MalformedRecord), "{offset} = {value}");
    }
    let tick = headers()[5].to_bytes();
    let with = |offset: usize, value: u8| {
        let mut bytes = tick;
        bytes[offset] = value;
        RequestHeader::parse(&bytes)
    };
    assert_eq!(with(1, 64), Err(MalformedRecord), "an unknown pin");
    assert_eq!(with(2, 1), Err(MalformedRecord), "a tick has no payload");
    assert_eq!(with(4, 2), Err(MalformedRecord), "a channel without a pulse");
    assert_eq!(with(4, 17), Err(MalformedRecord), "an unknown pulse bit");
    assert_eq!(with(5, 2), Err(MalformedRecord), "an unknown self-test");
}

#[test]
fn what_was_answered_is_what_is_read() {
    let request = Request::Tick(SimulatedTick::default());
    for indicator in INDICATORS {
        let variants = [
            (false, false, false, None),
            (true, false, true, Some(Channel::A)),
            (false, true, true, Some(Channel::B)),
        ];
        for (a, b, fed, pulse) in variants {
            let relays = Channels { a, b };
            let outputs = Outputs { relays, laser_level: 77, indicator, warning: b, pulse };
            let reply = Reply { outputs, fed, status: [9; STATUS_LENGTH] };
            assert_eq!(Reply::parse(&reply.to_bytes(request), request), Ok(reply));
            assert_eq!(Reply::parse(&reply.to_bytes(request), Request::Exchange), Err(MalformedRecord));
        }
    }
    let good = Reply { outputs: Outputs::SAFE, fed: false, status: [0; STATUS_LENGTH] }.to_bytes(request);
    for (offset, value) in [(0, 3), (1, 24), (1, 32), (3, 5), (4, 2), (5, 1), (6, 1), (7, 1)] {
        let mut bytes = good;
        bytes[offset] = value;
        assert_eq!(Reply::parse(&bytes, request), Err(MalformedRecord), "{offset} = {value}");
    }
    let safe = Reply { outputs: Outputs::SAFE, fed: false, status: [0; STATUS_LENGTH] };
    for unanswered in [Request::Hang, Request::Page] {
        assert_eq!(Reply::parse(&safe.to_bytes(unanswered), unanswered), Err(MalformedRecord));
    }
}

#[test]
fn simulated_self_tests_say_to_the_controller_what_they_are() {
    use crate::selftest::Verdict;
    let now = Micros::from_millis(77);
    let verdict = |self_test| {
        SimulatedTick { self_test, ..SimulatedTick::default() }.inputs(now).self_test.verdict(now)
    };
    assert_eq!(verdict(SimulatedSelfTest::Passed), Verdict::Passed);
    assert_eq!(verdict(SimulatedSelfTest::Pending), Verdict::Pending);
    for kind in SelfTestKind::ALL {
        assert_eq!(verdict(SimulatedSelfTest::Failed(kind)), Verdict::Failed(kind));
    }
    let pins = PinInputs { reset_pressed: true, ..PinInputs::default() };
    assert_eq!(SimulatedTick { pins, ..SimulatedTick::default() }.inputs(now).pins, pins);
}

#[test]
fn an_answer_names_the_request_that_it_answers() {
    let reply = Reply { outputs: Outputs::SAFE, fed: false, status: [0; STATUS_LENGTH] };
    let requests = [Request::Start, Request::Tick(SimulatedTick::default()), Request::Exchange];
    for asked in requests {
        for awaited in requests {
            let read = Reply::parse(&reply.to_bytes(asked), awaited);
            assert_eq!(read.is_ok(), asked == awaited, "{asked:?} {awaited:?}");
        }
    }
    assert_eq!(MalformedRecord.to_string(), "malformed lock-step record");
}

/// The bits of a pulse test's result, as the other side writes them.
#[test]
fn a_pulse_s_bits_mean_what_the_format_says() {
    let pulse = |channel, a, b| Some(Some(PulseReadback { channel, coils: Channels { a, b } }));
    assert_eq!(pulse_from_bits(0b0000), Some(None));
    assert_eq!(pulse_from_bits(0b0001), pulse(Channel::A, false, false));
    assert_eq!(pulse_from_bits(0b0011), pulse(Channel::B, false, false));
    assert_eq!(pulse_from_bits(0b0101), pulse(Channel::A, true, false));
    assert_eq!(pulse_from_bits(0b1001), pulse(Channel::A, false, true));
    assert_eq!(pulse_from_bits(0b1111), pulse(Channel::B, true, true));
    for bits in [0b0010, 0b1110, 0b1_0001] {
        assert_eq!(pulse_from_bits(bits), None, "{bits:b}");
    }
}
