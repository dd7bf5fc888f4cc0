//! Round trip of the paper's packets: they are read as they were written, byte by byte where the
//! paper defines it, and all else is refused.
#![allow(clippy::unwrap_used)]

use ferrostep_gpre::Fault;
use ferrostep_papers::wide::{Packet, STATUS_BYTES, Status, TRAJECTORY_BYTES, Trajectory};
use proptest::prelude::*;

fn trajectory() -> impl Strategy<Value = Trajectory> {
    let steps = [0u32..=1 << 28, 0u32..=1 << 28, 0u32..=1 << 28];
    let speeds = (1u32..u32::MAX, any::<u32>(), any::<u32>());
    (steps, 0u32..1 << 31, speeds, 1u32..u32::MAX, 1u32..u32::MAX, any::<[u32; 7]>(), 0u32..16, 0u32..4).prop_map(
        |([x, y, z], e, (nominal_speed, max, entry), millimeters, acceleration, rest, direction_bits, flag)| {
            let max_entry_speed = max.min(nominal_speed);
            Trajectory {
                steps: [x, y, z, e],
                step_event_count: x.max(y).max(z),
                accelerate_until: rest[0],
                decelerate_after: rest[1],
                direction_bits,
                nominal_speed,
                entry_speed: entry.min(max_entry_speed),
                max_entry_speed,
                millimeters,
                acceleration,
                nominal_length_flag: flag,
                nominal_rate: rest[2],
                initial_rate: rest[3],
                final_rate: rest[4],
                extruder_rate: rest[5],
                acceleration_st: rest[6],
            }
        },
    )
}

fn status() -> impl Strategy<Value = Status> {
    prop_oneof![
        (0u32..1 << 24).prop_map(Status::Line),
        any::<(u16, u8)>().prop_map(|(length_10nm, lines_before)| Status::InnerEnd { length_10nm, lines_before }),
        any::<[i8; 3]>().prop_map(Status::InnerSteps),
        any::<(i16, bool)>().prop_map(|(travel_256ths, ends_move)| Status::InnerExtruder { travel_256ths, ends_move }),
        any::<u8>().prop_map(Status::Fan),
        any::<[u8; 3]>().prop_map(Status::Text),
        (0u8..12, any::<u16>()).prop_map(|(part, bits)| Status::Place { part, bits }),
    ]
}

proptest! {
    #[test]
    fn packets_come_back(
        packets in proptest::collection::vec(
            prop_oneof![trajectory().prop_map(Packet::Trajectory), status().prop_map(Packet::Status)], 1..20,
        ),
    ) {
        let mut bytes = Vec::new();
        packets.iter().for_each(|packet| packet.write(&mut bytes));
        let mut rest = &bytes[..];
        for packet in &packets {
            let length = Packet::length(*rest.first_chunk().unwrap()).unwrap();
            let expected = if matches!(packet, Packet::Trajectory(_)) { TRAJECTORY_BYTES } else { STATUS_BYTES };
            prop_assert_eq!(length, expected);
            prop_assert_eq!(Packet::read(&rest[..length]), Ok(*packet));
            prop_assert_eq!(Packet::read(&rest[..length - 1]), Err(Fault::Truncated));
            rest = &rest[length..];
        }
        prop_assert!(rest.is_empty());
    }

    #[test]
    fn any_bytes_are_answered(bytes in proptest::collection::vec(any::<u8>(), 0..100), kind in 0u8..3) {
        let mut bytes = bytes;
        if kind > 0 {
            let start = if kind == 1 { b"GPRE" } else { b"STAT" };
            bytes.splice(..bytes.len().min(4), *start);
        }
        if let Ok(Packet::Trajectory(read)) = Packet::read(&bytes) {
            prop_assert!(read.entry_speed <= read.nominal_speed && read.steps[0] <= 1 << 28);
        }
    }
}

#[test]
fn the_values_stand_where_the_paper_has_them() {
    let mut bytes = Vec::new();
    for index in 1u32..=19 {
        bytes.extend_from_slice(&index.to_le_bytes());
    }
    let mut packet = b"GPRE".to_vec();
    packet.extend(&bytes);
    packet.extend(b"ERPG");
    // 5 is the largest of 1 to 3, 8 and 14 are flags, 11 is at most 9.
    for (value, number) in [(5, 3u32), (14, 1), (10, 4), (11, 5)] {
        packet[4 * value..4 * value + 4].copy_from_slice(&number.to_le_bytes());
    }
    let Packet::Trajectory(read) = Packet::read(&packet).unwrap() else { panic!("a trajectory") };
    assert_eq!(read.numbers(), [1, 2, 3, 4, 3, 6, 7, 8, 9, 4, 5, 12, 13, 1, 15, 16, 17, 18, 19]);
    assert_eq!(read.signed_steps(), [1, 2, 3, -4]);
}
