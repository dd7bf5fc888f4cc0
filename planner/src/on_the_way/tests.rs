//! Ways and rides against what defines them.
#![allow(clippy::unwrap_used)]

use super::*;
use proptest::prelude::*;

fn leg() -> impl Strategy<Value = Leg> {
    let corner = prop_oneof![Just(0.0), 0.1..60.0f32];
    (0.05..150.0f32, 5.0..500.0f32, 100.0..20_000.0f32, corner).prop_map(|(length, feed, acceleration, corner)| Leg {
        length_mm: length,
        feed_mm_per_s: feed,
        acceleration_mm_per_s2: acceleration,
        entry_mm_per_s: smaller(corner, feed),
    })
}

fn legs() -> impl Strategy<Value = Vec<Leg>> {
    prop::collection::vec(leg(), 1..=MOST_LEGS).prop_map(|mut legs| {
        join(&mut legs);
        legs
    })
}

fn law() -> impl Strategy<Value = FilamentLaw> {
    let figures = (0.02..10.0f32, 5.0..100.0f32, 300.0..10_000.0f32, any::<bool>());
    figures.prop_map(|(filament_mm, feed_mm_per_s, acceleration_mm_per_s2, keeps_acceleration)| FilamentLaw {
        filament_mm,
        feed_mm_per_s,
        acceleration_mm_per_s2,
        keeps_acceleration,
    })
}

/// Checks stage by stage that the filament that rides keeps to its law, in both directions.
fn check(way: &Way<'_>, law: &FilamentLaw, ride: &Ride) -> Result<(), TestCaseError> {
    let (mut sum_mm, mut before): (f32, Option<(Stage, f32)>) = (0.0, None);
    for number in 1..=ride.stages {
        let (stage, filament_mm) = law.stage(way, ride, number).unwrap();
        let course = way.course(stage.leg);
        let begin_s = before.filter(|_| !stage.begins_leg).map_or(0.0, |(before, _)| before.end_s);
        // One after the other, along all of every leg before the last.
        match before {
            None => prop_assert!(stage.leg == 0 && stage.begins_leg),
            Some((before, _)) if before.ends_leg => prop_assert!(stage.leg == before.leg + 1 && stage.begins_leg),
            Some((before, _)) => prop_assert!(stage.leg == before.leg && (stage.begin_mm - before.end_mm).abs() < 1e-3),
        }
        let length_mm = stage.end_mm - stage.begin_mm;
        prop_assert!(length_mm > 0.0 && filament_mm > 0.0, "{stage:?}");
        let ratio = filament_mm / length_mm;
        let most = course.most_mm_per_s(begin_s, stage.end_s);
        prop_assert!(ratio * most <= law.feed_mm_per_s * 1.001, "{stage:?}");
        if law.keeps_acceleration
            || begin_s + LEAST_STAGE_S < course.up_s
            || stage.end_s > course.even_s + LEAST_STAGE_S
        {
            prop_assert!(ratio * course.acceleration_mm_per_s2 <= law.acceleration_mm_per_s2 * 1.001, "{stage:?}");
        }
        // Two moves may end along a leg.
        prop_assert!(!(stage.begins_leg && stage.ends_leg), "{stage:?}");
        sum_mm += filament_mm;
        before = Some((stage, ratio));
    }
    prop_assert!(law.stage(way, ride, ride.stages + 1).is_none());
    prop_assert!((sum_mm - law.filament_mm).abs() <= 1e-4 * law.filament_mm, "{sum_mm}");
    Ok(())
}

proptest! {
    #[test]
    fn a_way_comes_to_rest_and_keeps_its_accelerations(legs in legs(), slowness in 1.0..4.0f32, is_backwards: bool) {
        let way = Way { legs: &legs, slowness, is_backwards };
        let mut end: Option<f32> = None;
        for number in 0..legs.len() {
            let course = way.course(number);
            // Speeds differ by no more than rounding where legs meet, and the ramps take no
            // more than the leg.
            if let Some(end) = end {
                prop_assert!((course.begin_mm_per_s - end).abs() < 1e-3);
            }
            end = Some(course.end_mm_per_s);
            prop_assert!(course.up_s >= 0.0 && course.even_s >= course.up_s && course.duration_s >= course.even_s);
            let mut before_mm = -1e-3 * course.length_mm;
            for share in 0..=64_u8 {
                let mm = course.mm_after(course.duration_s * f32::from(share) / 64.0);
                prop_assert!(mm >= before_mm, "{course:?}");
                before_mm = mm - 1e-3 * course.length_mm;
            }
            let sum_mm = course.mm_after(course.even_s) + 0.5 * (course.peak_mm_per_s + course.end_mm_per_s) * (course.duration_s - course.even_s);
            prop_assert!((sum_mm - course.length_mm).abs() < 2e-3 * course.length_mm, "{sum_mm} {course:?}");
        }
        if !is_backwards {
            prop_assert_eq!(end, Some(0.0));
        }
    }

    #[test]
    fn what_rides_keeps_to_its_law(legs in legs(), first in prop::option::of(law()), last in prop::option::of(law())) {
        let spread = Spread::of(&legs, first.as_ref(), last.as_ref());
        let way_s = Way { legs: &legs, slowness: 1.0, is_backwards: false }.duration_s();
        prop_assert!(spread.slowness >= 1.0 && spread.slowness <= MOST_SLOWNESS);
        let (mut ends_s, mut stops_s, mut rest_s) = (0.0, way_s, 0.0);
        for (law, ride, is_backwards) in [(&first, &spread.retraction, false), (&last, &spread.recovery, true)] {
            let Some(law) = law else {
                prop_assert!(ride.is_none());
                continue;
            };
            stops_s += law.duration_s();
            let Some(ride) = ride else {
                rest_s += law.duration_s();
                continue;
            };
            check(&Way { legs: &legs, slowness: spread.slowness, is_backwards }, law, ride)?;
            ends_s += ride.end_s;
        }
        // The filament moves do not overlap, and take no more time than stops.
        prop_assert!(ends_s <= spread.slowness * way_s * 1.000_1);
        prop_assert!(spread.slowness * way_s + rest_s <= stops_s * 1.000_1);
    }

    #[test]
    fn nothing_is_slowed_where_there_is_time(mut legs in legs(), law in law()) {
        let law = FilamentLaw { keeps_acceleration: false, ..law };
        // One of the legs alone is long enough, with as much again for steps, and not too far away
        // for the number of stages.
        legs.truncate(2);
        for leg in legs.iter_mut().take(1) {
            leg.length_mm = leg.feed_mm_per_s * (4.0 * law.duration_s() + 0.1);
        }
        join(&mut legs);
        let spread = Spread::of(&legs, Some(&law), Some(&law));
        prop_assert!(spread.slowness <= 1.0 && spread.retraction.is_some() && spread.recovery.is_some(), "{spread:?}");
    }
}
