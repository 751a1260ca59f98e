use answers::recorded::{self, sightings::Assumptions}; use calib_core::camera::*; use std::{fs::File, io::BufReader};
#[test] fn zz() {
 for (set, sig) in [("mrclam1", 0.0086), ("mrclam9", 0.0119), ("mrclam5_every8th", 0.0086)] {
  let a = Assumptions { camera: None, bearing_sigma: Some(sig), target_sigma: 0.0 };
  let r = recorded::sightings::read(BufReader::new(File::open(format!("/work/shared/data/mrclam/{set}_sightings.csv")).unwrap()), &a, |_| ()).unwrap();
  for p in [Projection::PinHole, Projection::EqualAngle] {
  let v = 65f64.to_radians();
  let c = Camera::new(p, 640, v).unwrap();
  println!("{set} {p:?} {:?}", answers::lens::check(&r, &c, v, 0.02).map(|l| (l, l.field_of_view.to_degrees())));
 }}
 for seed in ["1", "11"] { for p in [Projection::PinHole, Projection::EqualAngle] { for v in [60f64, 57.0, 63.0] {
  let v = v.to_radians();
  let c = Camera::new(p, 88, v).unwrap();
  let a = Assumptions { camera: Some(c), ..Assumptions::default() };
  let Ok(f) = File::open(format!("tests/data/stage13/seed{seed}_sightings.csv")).or_else(|_| File::open(format!("data/stage13/seed{seed}_sightings.csv"))) else { continue };
  let r = recorded::sightings::read(BufReader::new(f), &a, |_| ()).unwrap();
  println!("{seed} {p:?} {v} {:?}", answers::lens::check(&r, &c, v, 0.02).map(|l| (l, l.field_of_view.to_degrees())));
 }}}
}
