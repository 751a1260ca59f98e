//! Films of drawn scenes, as other cameras and their compression would make them.

use std::{
    fs::File,
    io::{BufReader, Write},
    path::Path,
    process::{Command, Stdio},
};

use cmucam2_emulator::{Background, Extent, Object, Picture, Place, Rgb, Scene, Shape};
use host_sim::video::Video;
use y4m::{Colorspace, Frame, Ratio, VendorExtensionString};

/// The lit side of the ball.
pub(crate) const ORANGE: Rgb = [220, 110, 40];
/// Its shady side.
const SHADE: Rgb = [160, 78, 28];
/// Both colours, with the effects of noise and compression.
pub(crate) const BOUNDS: &str = "130 240 50 150 16 75";

/// A room with boards and cupboards, some of them brown.
pub(crate) fn room(number: u8) -> Background {
    let colours: &[Rgb] = match number {
        0 => &[[120, 118, 110], [96, 100, 104], [140, 136, 130]],
        1 => &[
            [150, 130, 105],
            [90, 80, 70],
            [60, 90, 120],
            [170, 165, 160],
            [110, 110, 90],
        ],
        _ => &[[70, 75, 80], [85, 110, 80], [128, 100, 85], [100, 105, 130]],
    };
    Background::Blocks {
        columns: 5 + 2 * u16::from(number),
        rows: 3,
        colours: colours.to_vec(),
    }
}

/// A ball that is lit from above, and the shadow that it casts.
pub(crate) fn lit_ball(ball: Extent) -> Vec<Object> {
    let (width, height) = (ball.right - ball.left, ball.bottom - ball.top);
    let lit = Extent {
        left: ball.left + 0.1 * width,
        top: ball.top,
        right: ball.right - 0.1 * width,
        bottom: ball.bottom - 0.3 * height,
    };
    let shadow = Extent::centred(
        f64::midpoint(ball.left, ball.right) + 0.3 * width,
        ball.bottom,
        1.5 * width,
        0.3 * height,
    );
    let object = |colour, extent| Object {
        colour,
        shape: Shape::Disc,
        place: Place::At(extent),
    };
    vec![
        object([45, 42, 40], shadow),
        object(SHADE, ball),
        object(ORANGE, lit),
    ]
}

/// A camera that films.
pub(crate) struct Shot {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Pictures a second.
    pub(crate) rate: usize,
    /// The greatest change of a pixel's luminance.
    pub(crate) noise: u8,
}

impl Shot {
    /// Makes so many pictures as YUV4MPEG2, 4:2:0.
    pub(crate) fn film(
        &self,
        out: impl Write,
        count: usize,
        mut scene: impl FnMut(usize) -> Scene,
    ) {
        let Self {
            width,
            height,
            rate,
            noise,
        } = *self;
        let range = VendorExtensionString::new(b"COLORRANGE=FULL".to_vec()).unwrap();
        let mut film = y4m::encode(width, height, Ratio::new(rate, 1))
            .with_colorspace(Colorspace::C420jpeg)
            .append_vendor_extension(range)
            .write_header(out)
            .unwrap();
        let mut random = 1_u64;
        for index in 0..count {
            let picture = scene(index).picture(0.0, width, height).unwrap();
            let Picture {
                luminance,
                chrominance,
                ..
            } = &picture;
            let half = |length: usize| length.div_ceil(2) as u16;
            let [blue, red] = chrominance.as_ref().unwrap();
            let [blue, red] = [blue, red].map(|plane| plane.scaled(half(width), half(height)));
            let noisy = luminance.samples().iter().map(|&level| {
                random = random
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                let change = (random >> 33) % (2 * u64::from(noise) + 1);
                level.saturating_add(change as u8).saturating_sub(noise)
            });
            let noisy: Vec<u8> = noisy.collect();
            let planes = [&noisy[..], blue.samples(), red.samples()];
            film.write_frame(&Frame::new(planes, None)).unwrap();
        }
    }

    /// The same in a file.
    pub(crate) fn file(&self, path: &Path, count: usize, scene: impl FnMut(usize) -> Scene) {
        let mut file = std::io::BufWriter::new(File::create(path).unwrap());
        self.film(&mut file, count, scene);
        file.flush().unwrap();
    }

    /// The same, compressed by ffmpeg to a file that it can read, with this constant rate factor of
    /// H.264: 0 loses nothing, 23 is usual.
    pub(crate) fn compressed(
        &self,
        path: &Path,
        quality: u8,
        count: usize,
        scene: impl FnMut(usize) -> Scene,
    ) {
        let mut ffmpeg = ffmpeg()
            .args([
                "-f",
                "yuv4mpegpipe",
                "-i",
                "-",
                "-c:v",
                "libx264",
                "-preset",
                "veryfast",
            ])
            .args(["-crf", &quality.to_string(), "-y"])
            .arg(path)
            .stdin(Stdio::piped())
            .spawn()
            .expect("ffmpeg is needed: `cargo xtask test` installs it");
        let input = std::io::BufWriter::new(ffmpeg.stdin.take().unwrap());
        self.film(input, count, scene);
        assert!(ffmpeg.wait().unwrap().success());
    }
}

pub(crate) fn ffmpeg() -> Command {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error"]);
    ffmpeg
}

/// The video that ffmpeg makes of a file, called as in the documentation.
pub(crate) fn played(path: &Path) -> Video {
    let mut ffmpeg = ffmpeg()
        .arg("-i")
        .arg(path)
        .args(["-pix_fmt", "yuv420p", "-f", "yuv4mpegpipe", "-"])
        .stdout(Stdio::piped())
        // It complains about a reader that does not read the film to its end.
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let pictures = BufReader::new(ffmpeg.stdout.take().unwrap());
    // It ends when its pipe does.
    std::thread::spawn(move || ffmpeg.wait());
    Video::new(pictures).unwrap()
}
