//! The paper's packets: for any bytes, values that are read are in range and are
//! written back unchanged.
#![no_main]

use ferrostep_papers::wide::Packet;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut rest = bytes;
    while let Some(start) = rest.first_chunk::<4>() {
        let Ok(length) = Packet::length(*start) else { return };
        let Ok(packet) = Packet::read(rest) else { return };
        if let Packet::Trajectory(trajectory) = &packet {
            assert!(trajectory.entry_speed <= trajectory.nominal_speed);
            assert!(trajectory.signed_steps()[..3].iter().all(|steps| steps.unsigned_abs() <= 1 << 28));
        }
        let mut again = Vec::new();
        packet.write(&mut again);
        assert_eq!(Packet::read(&again), Ok(packet));
        rest = &rest[length..];
    }
});
