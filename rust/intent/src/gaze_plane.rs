use proact_types::{GazeSample, Point};

/// Where the gaze meets the horizontal plane at `height` (metres, `world`); none if it looks level, up and away,
/// or is not finite. (The original also takes rays that point up.)
pub fn gaze_plane_intersection(gaze: &GazeSample, height: f64) -> Option<Point> {
    let descent = gaze.direction.z;
    let distance = (height - gaze.origin.z) / descent;
    let level = descent.abs() <= 1e-4 * gaze.direction.norm();
    if level || !distance.is_finite() || distance <= 0.0 {
        return None;
    }
    let hit = gaze.origin + gaze.direction * distance;
    hit.coords.iter().all(|v| v.is_finite()).then_some(hit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Vector;

    fn hit(direction: Vector) -> Option<Point> {
        gaze_plane_intersection(
            &GazeSample { origin: Point::new(0.0, 0.0, 2.0), direction, valid: true },
            1.0,
        )
    }

    #[test]
    fn a_gaze_down_meets_the_table_and_one_up_level_or_broken_does_not() {
        assert_eq!(hit(Vector::new(1.0, 0.5, -1.0)), Some(Point::new(1.0, 0.5, 1.0)));
        for missed in [Vector::new(1.0, 0.0, 1.0), Vector::x(), Vector::new(1.0, 0.0, -1e-6), Vector::zeros()]
        {
            assert_eq!(hit(missed), None, "{missed}");
        }
        assert_eq!(hit(Vector::new(f64::NAN, 0.0, -1.0)), None);
    }
}
