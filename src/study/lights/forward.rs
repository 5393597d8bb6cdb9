//! Balls, lamps and camera of known truth. Nothing of the estimator is used: highlights by bisection of the mirror law, outlines
//! as the circle in which a sight cone touches its ball.

use crate::numerics::geometry::{Projection, Vec3};
use rand::RngExt;
use rand_distr::StandardNormal;
use std::f64::consts::{FRAC_PI_2, TAU};

/// The rig.
pub struct Rig {
    /// The camera.
    pub projection: Projection,
    /// Columns and rows.
    pub size: (usize, usize),
    /// Centres of the balls, mm.
    pub balls: Vec<Vec3>,
    /// Their radius, mm.
    pub radius: f64,
    /// Angles of the arm as it says, degrees.
    pub angles_deg: Vec<f64>,
    /// Positions of the lamps, mm.
    pub lamps: Vec<Vec3>,
}

/// One normal number.
pub fn normal(random: &mut impl RngExt) -> f64 {
    random.sample(StandardNormal)
}

impl Rig {
    /// Three balls of 20 mm radius within 95 mm of the axis at 2 m, seven lamps on a circle of 800 mm about the vertical through
    /// them, 250 mm above; an EOS 5D with 200 mm. The arm stands where its encoder says up to 0.05 degrees (standard deviation),
    /// its axis leans by a degree or so, and the balls lie where a hand put them. `scale` makes the sensor's pixels coarser
    /// (0.25: a quarter as many a millimetre); the frame is the part of the sensor that the balls need.
    pub fn draw(scale: f64, random: &mut impl RngExt) -> Self {
        let balls = [[-90.0, 40.0, 1990.0], [10.0, -55.0, 2020.0], [90.0, 55.0, 2005.0]];
        let mut jitter = |size: f64| Vec3::from_fn(|_, _| size * normal(random));
        let balls = balls.iter().map(|b| Vec3::from_row_slice(b) + jitter(2.0)).collect();
        let center = Vec3::new(0.0, -250.0, 2000.0) + jitter(10.0);
        let lean = jitter(0.02);
        let zero = 0.03 * normal(random);
        let angles_deg = vec![-55.0, -20.0, 15.0, 50.0, 85.0, 115.0, 140.0];
        let lamp = |angle: &f64| {
            let turned = angle.to_radians() + zero + 0.05_f64.to_radians() * normal(random);
            // Angle 0 lies between object and camera, positive angles turn towards +x.
            let flat = Vec3::new(800.0 * turned.sin(), 0.0, -800.0 * turned.cos());
            center + turn(&flat, &lean)
        };
        let lamps = angles_deg.iter().map(lamp).collect();
        let projection = Projection::Pinhole {
            focal_px: [24_390.0 * scale; 2],
            principal_px: [1456.0 * scale, 1092.0 * scale],
            distortion: [0.0; 5],
        };
        let size = ((2912.0 * scale) as usize, (2184.0 * scale) as usize);
        Self { projection, size, balls, radius: 20.0, angles_deg, lamps }
    }

    /// Point of a ball that mirrors a lamp into the camera: where sight and light make equal angles with the normal.
    pub fn mirror_point(&self, ball: usize, lamp: usize) -> Vec3 {
        let (center, lamp) = (self.balls[ball], self.lamps[lamp]);
        let (to_eye, to_lamp) = (-center.normalize(), (lamp - center).normalize());
        let on = |t: f64| {
            // Great circle from the direction of the eye to that of the lamp.
            let whole = to_eye.dot(&to_lamp).acos();
            (to_eye * ((1.0 - t) * whole).sin() + to_lamp * (t * whole).sin()) / whole.sin()
        };
        let excess = |t: f64| {
            let n = on(t);
            let p = center + n * self.radius;
            n.dot(&(lamp - p).normalize()) - n.dot(&(-p).normalize())
        };
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..80 {
            let t = 0.5 * (low + high);
            if excess(t) < 0.0 { low = t } else { high = t }
        }
        center + on(0.5 * (low + high)) * self.radius
    }

    /// Where the camera sees that point, pixels.
    pub fn highlight(&self, ball: usize, lamp: usize) -> [f64; 2] {
        self.projection.project(&self.mirror_point(ball, lamp))
    }

    /// Points of a ball's outline, pixels.
    pub fn outline(&self, ball: usize, count: usize) -> Vec<[f64; 2]> {
        let c = self.balls[ball];
        let d2 = c.norm_squared();
        let foot = c * (1.0 - self.radius * self.radius / d2);
        let reach = self.radius * (1.0 - self.radius * self.radius / d2).sqrt();
        let e1 = c.cross(&Vec3::y()).normalize();
        let e2 = c.cross(&e1).normalize();
        let at = |i: usize| {
            let (sin, cos) = (TAU * i as f64 / count as f64).sin_cos();
            self.projection.project(&(foot + (e1 * cos + e2 * sin) * reach))
        };
        (0..count).map(at).collect()
    }

    /// The outline with every point moved across it by normal noise, pixels.
    pub fn noisy_outline(&self, ball: usize, count: usize, noise_px: f64, random: &mut impl RngExt) -> Vec<[f64; 2]> {
        let exact = self.outline(ball, count);
        let along = |i: usize| {
            let (a, b) = (exact[(i + count - 1) % count], exact[(i + 1) % count]);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            [(b[0] - a[0]) / length, (b[1] - a[1]) / length]
        };
        (0..count)
            .map(|i| {
                let ([x, y], off) = (along(i), noise_px * normal(random));
                [exact[i][0] + y * off, exact[i][1] - x * off]
            })
            .collect()
    }
}

/// A vector turned about `axis` by its length (Rodrigues).
fn turn(v: &Vec3, axis: &Vec3) -> Vec3 {
    let angle = axis.norm();
    if angle == 0.0 {
        return *v;
    }
    let k = axis / angle;
    let (sin, cos) = angle.min(FRAC_PI_2).sin_cos();
    v * cos + k.cross(v) * sin + k * (k.dot(v) * (1.0 - cos))
}
