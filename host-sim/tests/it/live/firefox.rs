//! The same pages in Firefox.

use super::{
    browser::Browser,
    pages::{a_report_opens, a_simulation_shows_itself},
};

#[ignore = "needs Firefox and its driver: `cargo xtask peers`"]
#[tokio::test]
async fn firefox_opens_a_report() {
    a_report_opens(Browser::firefox().await).await;
}

#[ignore = "needs Firefox and its driver: `cargo xtask peers`"]
#[tokio::test]
async fn firefox_shows_a_simulation() {
    a_simulation_shows_itself(Browser::firefox().await).await;
}
