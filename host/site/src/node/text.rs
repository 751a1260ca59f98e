//! A configuration as text.

use node_firmware::config::{Config, RoleConfig, page};
use toml::{Table, Value};
use zigbee_link::security::Protection;

use super::{DISTORTION, NodeError, RoleName};

/// All of a configuration but its key, in the form in which [`config`](super::config) takes it.
///
/// # Errors
/// [`NodeError::Usual`]: a value that TOML cannot say.
pub fn text(config: &Config) -> Result<String, NodeError> {
    let channels = (11..=26).filter(|channel| config.channels >> channel & 1 == 1);
    let channels = Value::Array(channels.map(Value::Integer).collect());
    let protection = match config.protection {
        Protection::EncMic32 => 5,
        Protection::EncMic64 => 6,
    };
    let role = RoleName::from(&config.role);
    let own = match &config.role {
        RoleConfig::Camera(camera) => {
            let own = toml::to_string(camera)?;
            match camera.lens.distortion {
                [0.0, 0.0] => own,
                [k1, k2] => own.replace(
                    "[lens]\n",
                    &format!("[lens]\n{DISTORTION} = [{k1:?}, {k2:?}]\n"),
                ),
            }
        }
        RoleConfig::Target(target) => toml::to_string(target)?,
        RoleConfig::Coordinator(coordinator) => {
            let allow = coordinator.allow.iter().copied().map(i64::from);
            let allow: Vec<_> = allow.collect();
            let mut own = Table::new();
            own.insert("allow".into(), allow.into());
            let window = i64::from(coordinator.join_window_s);
            own.insert("join-window-s".into(), window.into());
            own.to_string()
        }
    };
    Ok(format!(
        "# configuration page, version {version}\n\
         # site key: index {index}, not shown\n\
         role = \"{role}\"\n\
         id = {id}\n\
         channels = {channels}\n\
         tx-power = {power}\n\
         protection = {protection}\n\
         sleep = {sleep}\n\
         {own}",
        version = page::version(config),
        index = config.site_key.index(),
        id = config.id,
        power = config.tx_power,
        sleep = config.sleeps,
    ))
}
