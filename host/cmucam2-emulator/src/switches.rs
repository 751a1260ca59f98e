//! Points of the protocol that the sources leave open: one switch for each.

use super::settings::settings;

settings! {
    /// The variants of a camera, as far as public sources leave them open.
    ///
    /// The defaults are those of most sources, and those that public programs need. The driver is to understand
    /// every position; its own list is `cmucam2_driver::uncertain`.
    pub struct Switches of u8 {
        /// Number of the first column, row and block
        origin = 1, up to 1;
        /// T coordinates count from 0 the frame, 1 the virtual window
        window_relative = 0, up to 1;
        /// Columns of a frame in low resolution: 0 as written, 1 one less
        narrow = 1, up to 1;
        /// The banner says 0 CMUcam2 v1.00, 1 CMUcam2 v1.01, 2 CMUcam2 v1.0, 3 CMUcam2+ v1.00,
        /// 4 CMUcam2 v2.0+, 5 CMUcam3 v1.0
        version = 0, up to 5;
        /// The module number in the banner: 0 c6 is the OV6620 and c7 the OV7620, 1 the other way
        /// round, 2 there is none
        module = 0, up to 2;
        /// A blank line before the banner of a reset: 0 no, 1 yes
        reset_blank_line = 0, up to 1;
        /// A carriage return between version and prompt: 0 no, 1 yes
        version_return = 1, up to 1;
        /// GT answers 0 in pairs as ST takes them, 1 all lower bounds first
        bounds_order = 0, up to 1;
        /// A lower bound above its upper one is 0 refused, 1 accepted and nothing is tracked
        inverted_bounds = 1, up to 1;
        /// TW sends an S packet first: 0 no, 1 yes
        window_mean = 0, up to 1;
        /// GH sends 0 one packet, 1 a stream
        histogram_stream = 0, up to 1;
        /// HC numbers of bins: 0 selects 28, 14 or 7 bins, 1 is the number itself
        histogram_bins = 0, up to 1;
        /// Under packet filter an empty packet begins a stream: 0 no, 1 yes
        filter_first = 1, up to 1;
        /// A stream that is stopped answers 0 the prompt, 1 ACK and the prompt
        stop_ack = 0, up to 1;
        /// A stop takes effect 0 after the packet under way, 1 within it
        stop_within_packet = 1, up to 1;
        /// A stop takes effect 0 after the frame that is being sent, 1 within it
        stop_within_frame = 1, up to 1;
        /// 02 between the rows of a frame: 0 no, nor before or after them, 1 yes
        row_marks = 1, up to 1;
        /// 02 before the first row of a frame: 0 no, 1 yes
        first_row_mark = 0, up to 1;
        /// 02 after the last row of a frame: 0 no, 1 yes
        last_row_mark = 1, up to 1;
        /// LM 1 says after FE how many rows follow: 0 no, 1 yes
        mean_lines_height = 1, up to 1;
        /// Time that a reset takes, in tenths of a second
        boot_time = 7, up to 10;
        /// Input while the camera starts is 0 lost, 1 obeyed when it has started
        boot_input = 1, up to 1;
        /// The prompt comes 0 when woken, 1 before sleep
        sleep_prompt = 1, up to 1;
        /// UD acknowledges 0 before its 64 bytes, 1 after them
        upload_ack = 0, up to 1;
        /// In raw output, S and H packets are 0 text, 1 raw
        raw_packets = 1, up to 1;
        /// In raw output, values are 0 text, 1 raw
        raw_values = 0, up to 1;
        /// Of a run of pixels in a row the noise filter counts 0 all, 1 those after the first ones
        noise_run = 0, up to 1;
        /// The pixel field of frame differencing is 0 the blocks, 1 by the formula of tracking
        difference_pixels = 0, up to 1;
        /// Every byte that is sent comes back: 0 no, 1 yes
        echo = 0, up to 1;
        /// ACK, NCK and packets of text end with 0 a carriage return, 1 a space before it, 2 a line feed after it
        line_end = 0, up to 2;
        /// The prompt has 0 nothing around it, 1 a space after it, 2 a line of its own
        prompt_line = 0, up to 2;
        /// After a stream was stopped, a packet that was on its way comes within the next ACK: 0 no, 1 yes
        late_packet = 0, up to 1;
        /// A window of fewer rows is read 0 as slowly as the frame, 1 in its share of the time
        window_rate = 1, up to 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SettingError;

    #[test]
    fn a_switch_is_set_by_its_name_within_its_positions() {
        let mut switches = Switches::default();
        assert_eq!(switches.set_from("origin=0"), Ok(()));
        assert_eq!(switches.origin, 0);
        for wrong in ["origin=2", "origin=", "origin=-1", "origin=x"] {
            let error = switches.set_from(wrong).unwrap_err();
            assert_eq!(error.to_string(), "`origin` must be 0 to 1", "{wrong}");
        }
        assert_eq!(switches.set_from("origin"), Err(SettingError::Form));
        assert!(
            switches
                .set_from("orgin=1")
                .unwrap_err()
                .to_string()
                .contains("there are origin,")
        );
    }

    #[test]
    fn the_table_tells_the_defaults() {
        let mut switches = Switches::default();
        for switch in Switches::TABLE {
            assert!(switch.default <= switch.greatest);
            assert!(switches.set(switch.name, switch.default).is_ok());
        }
        assert_eq!(switches, Switches::default());
    }
}
