//! Parameters of a node as options of the command line.

use anyhow::{Context, Result, ensure};
use toml::{Table, Value};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use site::node::RoleName;

use super::super::values;

/// Options stand over what the file says.
#[derive(clap::Args)]
pub(super) struct Options {
    /// Role of the node.
    #[arg(long, value_parser = role())]
    role: Option<RoleName>,
    /// The number by which people know the node, from 1.
    #[arg(long, value_parser = values::whole(1, u16::MAX))]
    id: Option<u16>,
    /// The 2.4 GHz channels the network may use, 11 to 26; without it, all.
    #[arg(long, value_delimiter = ',', value_name = "N,N", value_parser = values::whole(0, u8::MAX))]
    channels: Option<Vec<u8>>,
    /// Transmit power.
    #[arg(long, value_name = "DBM", allow_hyphen_values = true, value_parser = values::whole(i8::MIN, i8::MAX))]
    tx_power: Option<i8>,

    /// Model of its camera: `cmucam2`, unless said, or one of the others.
    #[arg(long, value_name = "CAMERA", help_heading = "Camera", value_parser = ["cmucam2", "pixy2", "pixy", "openmv", "openmv-tags"])]
    kind: Option<String>,
    /// Number of colours that a Pixy or an OpenMV Cam was taught, 1 to 4: signature 1 is target colour 0.
    #[arg(
        long, value_name = "N", help_heading = "Camera", conflicts_with_all = ["colour", "motion"],
        value_parser = values::whole(0, u8::MAX)
    )]
    signatures: Option<u8>,
    /// Columns of the lens: 88, or 160 with the OV7620.
    #[arg(long, help_heading = "Camera", value_parser = values::whole(0, u16::MAX))]
    columns: Option<u16>,
    /// Angle from the middle of the first column to that of the last one.
    #[arg(long, value_name = "DEGREES", help_heading = "Camera", value_parser = values::finite)]
    field_of_view: Option<f64>,
    /// Projection of the lens: `pin-hole` as real lenses, or `equal-angle`.
    #[arg(long, value_name = "KIND", help_heading = "Camera")]
    projection: Option<String>,
    /// Radial distortion of the lens, k1 and k2, as calibration tools print them.
    #[arg(
        long,
        value_name = "K1,K2",
        allow_hyphen_values = true,
        help_heading = "Camera"
    )]
    distortion: Option<String>,
    /// Baud rate that the CMUcam2's jumpers select.
    #[arg(long, help_heading = "Camera", value_parser = values::whole(0, u32::MAX))]
    baud: Option<u32>,
    /// It is a reference camera: `first` or `second`.
    #[arg(long, value_name = "DUTY", help_heading = "Camera")]
    reference: Option<String>,
    /// Place where the reference camera stands.
    #[arg(
        long,
        value_name = "X,Y",
        requires = "reference",
        allow_hyphen_values = true,
        help_heading = "Camera"
    )]
    position: Option<String>,
    /// Distance of the two reference cameras.
    #[arg(
        long,
        value_name = "LENGTH",
        help_heading = "Camera",
        value_parser = values::finite
    )]
    baseline: Option<f64>,
    /// Stops at which it wants to see the target.
    #[arg(long, help_heading = "Camera", value_parser = values::whole(0, u8::MAX))]
    stops: Option<u8>,
    /// Lowest and highest levels of red, green and blue of the target; again for the next target
    /// colour.
    #[arg(long, value_name = "R-R,G-G,B-B", help_heading = "Camera")]
    colour: Vec<String>,
    /// It looks for what moves, not for a colour: levels of difference, usually 5 to 20.
    #[arg(
        long,
        value_name = "LEVELS",
        conflicts_with = "colour",
        help_heading = "Camera",
        value_parser = values::whole(0, u8::MAX)
    )]
    motion: Option<u8>,

    /// Number of a node that may always join; again for the next one.
    #[arg(long, value_name = "N", help_heading = "Coordinator", value_parser = values::whole(1, u16::MAX))]
    allow: Vec<u16>,
    /// Time after start-up in which any device with the site key may join.
    #[arg(long, value_name = "SECONDS", help_heading = "Coordinator", value_parser = values::whole(0, u16::MAX))]
    join_window: Option<u16>,

    /// The target's colour number, from 0.
    #[arg(long, value_name = "N", help_heading = "Target", value_parser = values::whole(0, u8::MAX))]
    target_colour: Option<u8>,
    /// Offset of its step sensor's compass on each axis, uT.
    #[arg(
        long,
        value_name = "X,Y,Z",
        allow_hyphen_values = true,
        help_heading = "Target"
    )]
    hard_iron: Option<String>,
    /// Step length of its carrier, in the unit of the site, at a swing of 1 m/s^2; usually 0.45 m.
    #[arg(long, value_name = "K", help_heading = "Target", value_parser = values::finite)]
    step_length: Option<f64>,
    /// Standard deviation of its step sensor's constant error of heading; usually 3.
    #[arg(long, value_name = "DEGREES", help_heading = "Target", value_parser = values::finite)]
    systematic_heading: Option<f64>,
    /// Standard deviation of its step sensor's constant error of distance, as a share of it;
    /// usually 0.08, for a measured step length 0.03.
    #[arg(long, value_name = "SHARE", help_heading = "Target", value_parser = values::finite)]
    systematic_scale: Option<f64>,
}

impl Options {
    /// The options as a file would say them.
    pub(super) fn table(&self) -> Result<Table> {
        let mut table = Table::new();
        let mut put = |name: &str, value: Option<Value>| {
            if let Some(value) = value {
                table.insert(name.to_owned(), value);
            }
        };
        put("role", self.role.map(|role| role.to_string().into()));
        put("id", self.id.map(integer));
        let channels = self.channels.as_ref();
        put(
            "channels",
            channels.map(|all| list(all.iter().copied().map(integer))),
        );
        put("tx-power", self.tx_power.map(integer));

        put("kind", self.kind.clone().map(Value::String));
        let mut lens = Table::new();
        lens.extend(self.columns.map(|n| ("columns".to_owned(), integer(n))));
        let view = self.field_of_view.map(Value::Float);
        lens.extend(view.map(|view| ("field-of-view-deg".to_owned(), view)));
        let projection = self.projection.clone().map(Value::String);
        lens.extend(projection.map(|kind| ("projection".to_owned(), kind)));
        if let Some(text) = &self.distortion {
            let distortion = numbers::<2>(text).with_context(|| {
                format!("--distortion is two numbers, for example -0.2,0.03, not `{text}`")
            })?;
            lens.insert("distortion".to_owned(), distortion);
        }
        put("lens", some_table(lens));
        put("baud", self.baud.map(integer));
        let mut reference = Table::new();
        let duty = self.reference.clone().map(Value::String);
        reference.extend(duty.map(|duty| ("duty".to_owned(), duty)));
        if let Some(text) = &self.position {
            let position = numbers::<2>(text).with_context(|| {
                format!("--position is two numbers, for example 1.5,-2, not `{text}`")
            })?;
            reference.insert("position".to_owned(), position);
        }
        put("reference", some_table(reference));
        put("baseline", self.baseline.map(Value::Float));
        put("stops", self.stops.map(integer));
        put("subjects", self.subjects()?);

        let allow = list(self.allow.iter().copied().map(integer));
        put("allow", (!self.allow.is_empty()).then_some(allow));
        put("join-window-s", self.join_window.map(integer));
        put("colour", self.target_colour.map(integer));
        let mut sensor = Table::new();
        if let Some(text) = &self.hard_iron {
            let iron = numbers::<3>(text).with_context(|| {
                format!("--hard-iron is three numbers, for example 12.5,-40,3, not `{text}`")
            })?;
            sensor.insert("hard-iron".to_owned(), iron);
        }
        let length = self.step_length.map(Value::Float);
        sensor.extend(length.map(|length| ("step-length".to_owned(), length)));
        put("sensor", some_table(sensor));
        let heading = self.systematic_heading.map(Value::Float);
        put("systematic-heading-deg", heading);
        put("systematic-scale", self.systematic_scale.map(Value::Float));
        Ok(table)
    }

    fn subjects(&self) -> Result<Option<Value>> {
        let mut subjects = Table::new();
        if let Some(threshold) = self.motion {
            let motion = Table::from_iter([("threshold".to_owned(), integer(threshold))]);
            subjects.insert("motion".to_owned(), motion.into());
        }
        let signatures = self.signatures.map(integer);
        subjects.extend(signatures.map(|taught| ("signatures".to_owned(), taught)));
        if !self.colour.is_empty() {
            let windows = self.colour.iter().map(|text| window(text));
            let windows = windows.collect::<Result<_>>().map(Value::Array)?;
            subjects.insert("colours".to_owned(), windows);
        }
        Ok(some_table(subjects))
    }
}

/// A role's name.
fn role() -> impl TypedValueParser<Value = RoleName> {
    PossibleValuesParser::new(RoleName::ALL.map(RoleName::name))
        .try_map(|name| name.parse().map_err(|()| "there is no such role"))
}

fn integer(number: impl Into<i64>) -> Value {
    Value::Integer(number.into())
}

fn list(values: impl Iterator<Item = Value>) -> Value {
    Value::Array(values.collect())
}

fn some_table(table: Table) -> Option<Value> {
    (!table.is_empty()).then_some(Value::Table(table))
}

/// The given number of numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Option<Value> {
    let number = |text: &str| text.trim().parse().ok().map(Value::Float);
    let all: Vec<_> = text.split(',').map(number).collect::<Option<_>>()?;
    (all.len() == N).then_some(Value::Array(all))
}

fn window(text: &str) -> Result<Value> {
    let level = |text: &str| text.trim().parse::<u8>().ok().map(integer);
    let range = |text: &str| {
        let (lowest, highest) = text.split_once('-')?;
        Some(Value::Array(vec![level(lowest)?, level(highest)?]))
    };
    let ranges: Option<Vec<_>> = text.split(',').map(range).collect();
    let ranges = ranges.unwrap_or_default();
    ensure!(
        ranges.len() == 3,
        "--colour is three ranges of levels, for example 185-240,60-150,16-80, not `{text}`"
    );
    let names = ["red", "green", "blue"].map(str::to_owned);
    Ok(Table::from_iter(names.into_iter().zip(ranges)).into())
}
