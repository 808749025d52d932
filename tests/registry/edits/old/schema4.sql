BEGIN TRANSACTION;
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('0004');
CREATE TABLE bindings (
	id INTEGER NOT NULL, 
	robot_id INTEGER NOT NULL, 
	topic TEXT NOT NULL, 
	type_name TEXT NOT NULL, 
	slot_id INTEGER NOT NULL, 
	port TEXT NOT NULL, 
	publishes BOOLEAN NOT NULL, 
	reliable BOOLEAN NOT NULL, origin TEXT DEFAULT 'blueprint' NOT NULL, in_use BOOLEAN DEFAULT 1 NOT NULL, 
	CONSTRAINT pk_bindings PRIMARY KEY (id), 
	CONSTRAINT fk_bindings_robot_id FOREIGN KEY(robot_id) REFERENCES robots (id) ON DELETE CASCADE, 
	CONSTRAINT fk_bindings_slot_id FOREIGN KEY(slot_id) REFERENCES slots (id) ON DELETE CASCADE, 
	CONSTRAINT uq_bindings_slot_id UNIQUE (slot_id, port, topic, publishes)
);
INSERT INTO "bindings" VALUES(1,1,'HelloWorldTopic_1_to_2','HelloWorld',1,'out',1,1,'blueprint',1);
INSERT INTO "bindings" VALUES(2,1,'HelloWorldTopic_1_to_2','HelloWorld',2,'in',0,1,'blueprint',1);
INSERT INTO "bindings" VALUES(3,1,'HelloWorldTopic_2_to_3','HelloWorld',2,'out',1,1,'blueprint',1);
INSERT INTO "bindings" VALUES(4,1,'HelloWorldTopic_2_to_3','HelloWorld',3,'in',0,1,'blueprint',1);
INSERT INTO "bindings" VALUES(5,1,'HelloWorldTopic_3_to_1','HelloWorld',3,'out',1,1,'blueprint',1);
INSERT INTO "bindings" VALUES(6,1,'HelloWorldTopic_3_to_1','HelloWorld',1,'in',0,1,'blueprint',1);
CREATE TABLE blocks (
	kind TEXT NOT NULL, 
	"key" TEXT NOT NULL, 
	reason TEXT NOT NULL, 
	since_ns BIGINT NOT NULL, 
	CONSTRAINT pk_blocks PRIMARY KEY (kind, "key")
);
INSERT INTO "blocks" VALUES('number','WXYZ','recalled',1700000008000000000);
CREATE TABLE edits (
	id INTEGER NOT NULL, 
	robot_id INTEGER, 
	at_ns BIGINT NOT NULL, 
	who TEXT NOT NULL, 
	kind TEXT NOT NULL, 
	slot TEXT NOT NULL, 
	words TEXT NOT NULL, 
	"before" JSON NOT NULL, 
	"after" JSON NOT NULL, 
	undone_by INTEGER, 
	CONSTRAINT pk_edits PRIMARY KEY (id), 
	CONSTRAINT fk_edits_robot_id FOREIGN KEY(robot_id) REFERENCES robots (id) ON DELETE CASCADE
);
INSERT INTO "edits" VALUES(1,1,1700000005000000000,'Ann','value','AA','period_s of AA: 1 s -> 2.5 s','{"of": "value", "slot": "AA", "name": "period_s", "value": null}','{"of": "value", "slot": "AA", "name": "period_s", "value": 2.5}',NULL);
INSERT INTO "edits" VALUES(2,1,1700000006000000000,'Ann','place','','two belongs in no slot','{"of": "place", "parts": {"7365636f6e645549": ["BB", null]}}','{"of": "place", "parts": {"7365636f6e645549": [null, null]}}',NULL);
INSERT INTO "edits" VALUES(3,1,1700000007000000000,'Bob','place','BB','two is swapped into slot BB','{"of": "place", "parts": {"7365636f6e645549": [null, null]}}','{"of": "place", "parts": {"7365636f6e645549": ["BB", "BB"]}}',NULL);
INSERT INTO "edits" VALUES(4,1,1700000008000000000,'Ann','block','','part number WXYZ is blocked: recalled','{"of": "block", "kind": "number", "key": "WXYZ", "reason": ""}','{"of": "block", "kind": "number", "key": "WXYZ", "reason": "recalled"}',NULL);
INSERT INTO "edits" VALUES(5,1,1700000009000000000,'Ann','bind','','BB.in is taken off topic HelloWorldTopic_1_to_2','{"of": "bind", "topic": "HelloWorldTopic_1_to_2", "ends": [["AA", "out", "HelloWorld", true, true, "blueprint", true], ["BB", "in", "HelloWorld", false, true, "blueprint", true]]}','{"of": "bind", "topic": "HelloWorldTopic_1_to_2", "ends": [["AA", "out", "HelloWorld", true, true, "blueprint", true], ["BB", "in", "HelloWorld", false, true, "blueprint", false]]}',NULL);
INSERT INTO "edits" VALUES(6,1,1700000010000000000,'Bob','bind','','topic HelloWorldTopic_1_to_2 joins BB.in','{"of": "bind", "topic": "HelloWorldTopic_1_to_2", "ends": [["AA", "out", "HelloWorld", true, true, "blueprint", true], ["BB", "in", "HelloWorld", false, true, "blueprint", false]]}','{"of": "bind", "topic": "HelloWorldTopic_1_to_2", "ends": [["AA", "out", "HelloWorld", true, true, "blueprint", true], ["BB", "in", "HelloWorld", false, true, "blueprint", true]]}',NULL);
INSERT INTO "edits" VALUES(7,1,1700000011000000000,'Ann','apply','','the blueprint of MSBOT_MASTER is applied: profile, timing, options or descriptions','{"of": "apply", "robot": {"robot": {"name": "MSBOT_MASTER", "serial_number": "X100Y100Z100", "version": "MSBOT_V1", "released": "8-4-2021", "manufacturer": "MASSEY_ENGINEERING_DEP", "beat_period_s": 1.0, "tick_period_s": 2.0, "life": 3, "profile_period_s": 5.0, "explain": false, "free_topics": [], "authentication": "open"}, "slots": {"AA": {"position": 0, "part_number": "DIAL", "local_name": "ABCD-local", "description": "Light sensor, 5V"}, "BB": {"position": 1, "part_number": "EFGH", "local_name": "EFGH-local", "description": "Toggle switch, 5V"}, "CC": {"position": 2, "part_number": "WXYZ", "local_name": "WXYZ-local", "description": "Motor driver, 5V"}}, "bindings": [{"topic": "HelloWorldTopic_1_to_2", "type_name": "HelloWorld", "port": "out", "publishes": true, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "AA"}, {"topic": "HelloWorldTopic_1_to_2", "type_name": "HelloWorld", "port": "in", "publishes": false, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "BB"}, {"topic": "HelloWorldTopic_2_to_3", "type_name": "HelloWorld", "port": "out", "publishes": true, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "BB"}, {"topic": "HelloWorldTopic_2_to_3", "type_name": "HelloWorld", "port": "in", "publishes": false, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "CC"}, {"topic": "HelloWorldTopic_3_to_1", "type_name": "HelloWorld", "port": "out", "publishes": true, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "CC"}, {"topic": "HelloWorldTopic_3_to_1", "type_name": "HelloWorld", "port": "in", "publishes": false, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "AA"}], "settings": [{"name": "period_s", "origin": "hand", "value": 2.5, "changed_ns": 1700000005000000000, "who": "Ann", "slot": "AA"}, {"name": "period_s", "origin": "library", "value": 1, "changed_ns": 1700000001000000000, "who": "", "slot": "AA"}]}}','{"of": "apply", "robot": {"robot": {"name": "MSBOT_MASTER", "serial_number": "X100Y100Z100", "version": "MSBOT_V1", "released": "8-4-2021", "manufacturer": "MASSEY_ENGINEERING_DEP", "beat_period_s": 1.0, "tick_period_s": 2.0, "life": 3, "profile_period_s": 5.0, "explain": false, "free_topics": [], "authentication": "open"}, "slots": {"AA": {"position": 0, "part_number": "DIAL", "local_name": "ABCD-local", "description": "Sees the sun"}, "BB": {"position": 1, "part_number": "EFGH", "local_name": "EFGH-local", "description": "Toggle switch, 5V"}, "CC": {"position": 2, "part_number": "WXYZ", "local_name": "WXYZ-local", "description": "Motor driver, 5V"}}, "bindings": [{"topic": "HelloWorldTopic_1_to_2", "type_name": "HelloWorld", "port": "out", "publishes": true, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "AA"}, {"topic": "HelloWorldTopic_1_to_2", "type_name": "HelloWorld", "port": "in", "publishes": false, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "BB"}, {"topic": "HelloWorldTopic_2_to_3", "type_name": "HelloWorld", "port": "out", "publishes": true, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "BB"}, {"topic": "HelloWorldTopic_2_to_3", "type_name": "HelloWorld", "port": "in", "publishes": false, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "CC"}, {"topic": "HelloWorldTopic_3_to_1", "type_name": "HelloWorld", "port": "out", "publishes": true, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "CC"}, {"topic": "HelloWorldTopic_3_to_1", "type_name": "HelloWorld", "port": "in", "publishes": false, "reliable": true, "origin": "blueprint", "in_use": true, "slot": "AA"}], "settings": [{"name": "period_s", "origin": "hand", "value": 2.5, "changed_ns": 1700000005000000000, "who": "Ann", "slot": "AA"}, {"name": "period_s", "origin": "library", "value": 1, "changed_ns": 1700000001000000000, "who": "", "slot": "AA"}]}}',NULL);
INSERT INTO "edits" VALUES(8,1,1700000012000000000,'Ann','value','AA','period_s of AA: 2.5 s -> 3 s','{"of": "value", "slot": "AA", "name": "period_s", "value": 2.5}','{"of": "value", "slot": "AA", "name": "period_s", "value": 3}',9);
INSERT INTO "edits" VALUES(9,1,1700000013000000000,'Bob','undo','AA','edit 8 undone: period_s of AA: 2.5 s -> 3 s','{"of": "value", "slot": "AA", "name": "period_s", "value": 3}','{"of": "value", "slot": "AA", "name": "period_s", "value": 2.5}',NULL);
INSERT INTO "edits" VALUES(10,1,1700000014000000000,'Ann','stop','','STOP by Ann','{}','{}',NULL);
CREATE TABLE journal (
	id INTEGER NOT NULL, 
	robot_id INTEGER NOT NULL, 
	at_ns BIGINT NOT NULL, 
	part TEXT NOT NULL, 
	uid TEXT NOT NULL, 
	part_number TEXT NOT NULL, 
	local_name TEXT NOT NULL, 
	slot TEXT NOT NULL, 
	from_state TEXT NOT NULL, 
	to_state TEXT NOT NULL, 
	reason TEXT NOT NULL, 
	evidence JSON NOT NULL, 
	address TEXT NOT NULL, 
	CONSTRAINT pk_journal PRIMARY KEY (id), 
	CONSTRAINT fk_journal_robot_id FOREIGN KEY(robot_id) REFERENCES robots (id) ON DELETE CASCADE
);
CREATE TABLE keys (
	uid TEXT NOT NULL, 
	"key" BLOB NOT NULL, 
	created_ns BIGINT NOT NULL, 
	created_by TEXT NOT NULL, 
	CONSTRAINT pk_keys PRIMARY KEY (uid)
);
CREATE TABLE library (
	number TEXT NOT NULL, 
	name TEXT NOT NULL, 
	manufacturer TEXT NOT NULL, 
	description TEXT NOT NULL, 
	specification TEXT NOT NULL, 
	resolution TEXT NOT NULL, 
	compatible_with JSON NOT NULL, 
	ports JSON NOT NULL, 
	parameters JSON NOT NULL, 
	source TEXT NOT NULL, 
	digest TEXT NOT NULL, versions TEXT DEFAULT '' NOT NULL, 
	CONSTRAINT pk_library PRIMARY KEY (number)
);
INSERT INTO "library" VALUES('28BYJ-48','Stepper motor with driver','Kiatronics','Turns as quickly as it is told and counts its steps','5V, 2048 steps a turn','0.18 degrees','[]','[{"name": "speed", "direction": "subscribe", "type": "Speed", "rate_hz": 0.0, "safe": {"rpm": 0.0}}, {"name": "position", "direction": "publish", "type": "Count", "rate_hz": 5.0, "safe": null}]','[{"name": "steps_per_turn", "type": "int", "default": 2048, "unit": "", "min": 16.0, "max": 100000.0, "description": "Steps of a full turn"}, {"name": "most_rpm", "type": "float", "default": 15.0, "unit": "1/min", "min": 1.0, "max": 100.0, "description": "Never turns more quickly"}, {"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Turn the other way round"}, {"name": "period_s", "type": "float", "default": 0.2, "unit": "s", "min": 0.05, "max": 60.0, "description": "Says its position that often while it turns"}]','msbot library, 28BYJ-48.toml','05461922a9165d84dd5294b47cdb71c4ede018dd7ddba42bf1d5dc637ccf8b09','');
INSERT INTO "library" VALUES('ABCD','Light sensor','MASSEY_ENGINEERING_DEP','Measures brightness; in the sample robot it tells its neighbour which output to switch on','5V','tbd','[]','[{"name": "out", "direction": "publish", "type": "HelloWorld", "rate_hz": 1.0, "safe": null}, {"name": "in", "direction": "subscribe", "type": "HelloWorld", "rate_hz": 1.0, "safe": null}]','[]','msbot library, ABCD.toml','788d79028aefa03165e3fd97f61b71da9f0a0262d8f70f99f17e878ca41fa627','');
INSERT INTO "library" VALUES('BH1750','Light sensor','ROHM','Measures how bright it is','3.3 to 5V','1 lx','[]','[{"name": "light", "direction": "publish", "type": "Light", "rate_hz": 2.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.5, "unit": "s", "min": 0.12, "max": 60.0, "description": "Time between two measurements"}, {"name": "gain", "type": "float", "default": 1.0, "unit": "", "min": 0.1, "max": 100.0, "description": "Times this, for a window in front of it"}]','msbot library, BH1750.toml','9002502bd88a8bcd118ce1084990957ded6c0b999666bad9ab3c3dd3fe37d2eb','');
INSERT INTO "library" VALUES('BMP280','Air pressure sensor','Bosch','Measures pressure and warmth of the air','3.3V','0.01 hPa','[]','[{"name": "pressure", "direction": "publish", "type": "Pressure", "rate_hz": 2.0, "safe": null}, {"name": "temperature", "direction": "publish", "type": "Temperature", "rate_hz": 2.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.5, "unit": "s", "min": 0.05, "max": 60.0, "description": "Time between two measurements"}]','msbot library, BMP280.toml','65acff1070eea441eb72685069a95758740bcf3ef904e31fa53b7daab03d2085','');
INSERT INTO "library" VALUES('BUTTON','Push button','any','On while somebody presses it','3.3 to 5V','','[]','[{"name": "pressed", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Say on while it is not pressed"}]','msbot library, BUTTON.toml','3850ab4379e8f64cca78aa8b17f331a1af5a08c4259e497967ea685cd977f948','');
INSERT INTO "library" VALUES('BUZZER','Buzzer','any','Plays a tone, for a time or until the next one','3.3 to 5V','','[]','[{"name": "tone", "direction": "subscribe", "type": "Tone", "rate_hz": 0.0, "safe": {"hertz": 0.0, "seconds": 0.0}}]','[{"name": "volume", "type": "float", "default": 50.0, "unit": "%", "min": 0.0, "max": 100.0, "description": "How loud"}]','msbot library, BUZZER.toml','d6acb1fce746afd1b3e6e9fd9d2b16a1bee619174053c954552f734bf37aeb95','');
INSERT INTO "library" VALUES('CAM-TRIGGER','Camera trigger','any','Takes a picture for each message','3.3 to 5V','','[]','[{"name": "trigger", "direction": "subscribe", "type": "Trigger", "rate_hz": 0.0, "safe": null}, {"name": "taken", "direction": "publish", "type": "Count", "rate_hz": 0.0, "safe": null}]','[{"name": "pulse_s", "type": "float", "default": 0.2, "unit": "s", "min": 0.01, "max": 10.0, "description": "How long it presses the button"}]','msbot library, CAM-TRIGGER.toml','6635e83da42e5aca4ae9f794eee03286cc3e824897a91329b53f33a9803f1e2c','');
INSERT INTO "library" VALUES('DHT22','Temperature and humidity sensor','Aosong','Measures warmth and moisture of the air','3.3 to 5V','0.1 degrees, 0.1 %','[]','[{"name": "temperature", "direction": "publish", "type": "Temperature", "rate_hz": 0.5, "safe": null}, {"name": "humidity", "direction": "publish", "type": "Level", "rate_hz": 0.5, "safe": null}]','[{"name": "period_s", "type": "float", "default": 2.0, "unit": "s", "min": 2.0, "max": 3600.0, "description": "Time between two measurements"}, {"name": "offset", "type": "float", "default": 0.0, "unit": "\u00b0C", "min": -10.0, "max": 10.0, "description": "Added to the temperature"}]','msbot library, DHT22.toml','188aeab39e8d00f492db882d515b57861a7ae35bf336c848617be0555b537b51','');
INSERT INTO "library" VALUES('DS18B20','Waterproof temperature sensor','Analog Devices','Measures how warm something is, water too','3.3 to 5V','0.0625 degrees','[]','[{"name": "temperature", "direction": "publish", "type": "Temperature", "rate_hz": 1.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 1.0, "unit": "s", "min": 0.75, "max": 60.0, "description": "Time between two measurements"}, {"name": "offset", "type": "float", "default": 0.0, "unit": "\u00b0C", "min": -10.0, "max": 10.0, "description": "Added to each measurement"}]','msbot library, DS18B20.toml','5cbf3eec54828e39e1d72d0907fee246c6432721892c9dd798d2f486a4501692','');
INSERT INTO "library" VALUES('EFGH','Toggle switch','MASSEY_ENGINEERING_DEP','Eight inputs and outputs; switches the output that it is told and reports the state of one input','5V','tbd','[]','[{"name": "out", "direction": "publish", "type": "HelloWorld", "rate_hz": 1.0, "safe": null}, {"name": "in", "direction": "subscribe", "type": "HelloWorld", "rate_hz": 1.0, "safe": null}]','[]','msbot library, EFGH.toml','c23759ba9f887d11af4b061cc7fe14f9e668de41cc2c3d77c83fdd7e40808938','');
INSERT INTO "library" VALUES('ESTOP','STOP button','any','Says on while it is pressed; stays pressed until somebody turns it','3.3 to 24V','','[]','[{"name": "stop", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "repeat_s", "type": "float", "default": 0.5, "unit": "s", "min": 0.05, "max": 10.0, "description": "Says how it stands that often"}]','msbot library, ESTOP.toml','1400d3ce497de70f8ea9f74ff37f059935cf0a8fac7ebe6a3bda481a6be48367','');
INSERT INTO "library" VALUES('FAN-5V','Fan','any','Blows as strongly as it is told','5V','','[]','[{"name": "power", "direction": "subscribe", "type": "Level", "rate_hz": 0.0, "safe": {"percent": 0.0}}]','[{"name": "start_at", "type": "float", "default": 15.0, "unit": "%", "min": 0.0, "max": 50.0, "description": "Below this power it stands still"}]','msbot library, FAN-5V.toml','32815cfa7bebf87b7e932a31fddee4e5aeee79f1b904bb3740e0ac97f8787f5c','');
INSERT INTO "library" VALUES('GRIPPER','Gripper','any','Closes its fingers as far as it is told, or until it holds something','5V, opens 55 mm','1 mm','[]','[{"name": "grip", "direction": "subscribe", "type": "Level", "rate_hz": 0.0, "safe": {"percent": 0.0}}, {"name": "holding", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "speed", "type": "float", "default": 80.0, "unit": "mm/s", "min": 1.0, "max": 200.0, "description": "How quickly its fingers move"}, {"name": "width", "type": "float", "default": 55.0, "unit": "mm", "min": 1.0, "max": 200.0, "description": "How far it opens"}]','msbot library, GRIPPER.toml','1a2cdff2b835955d7d456025811586009c4f8c0740de8abb8cd41c59fff06614','');
INSERT INTO "library" VALUES('HC-SR04','Ultrasonic range sensor','any','Measures the distance to the next thing in front of it, 2 cm to 4 m','5V','3 mm','[]','[{"name": "distance", "direction": "publish", "type": "Distance", "rate_hz": 10.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.1, "unit": "s", "min": 0.06, "max": 60.0, "description": "Time between two measurements"}, {"name": "offset_m", "type": "float", "default": 0.0, "unit": "m", "min": -1.0, "max": 1.0, "description": "Added to each measurement, for example when the sensor stands back"}]','msbot library, HC-SR04.toml','ba88081254da967e0184c70c1818a1bcf22c7e9b11395f560ae4d581d4df6970','');
INSERT INTO "library" VALUES('HC-SR501','Motion sensor (PIR)','any','Notices somebody who moves, up to 7 m away','5V','','[]','[{"name": "motion", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Take on for off and off for on"}, {"name": "repeat_s", "type": "float", "default": 5.0, "unit": "s", "min": 0.0, "max": 3600.0, "description": "Says how it is that often; 0 = only when it changes"}]','msbot library, HC-SR501.toml','df44c9144b816e15dc532bc5b374e219063f930ea9d826b79242a9263ff9d256','');
INSERT INTO "library" VALUES('HX711','Load cell, 5 kg','Avia Semiconductor','Weighs what lies on it','3.3 to 5V','24 bit','[]','[{"name": "weight", "direction": "publish", "type": "Weight", "rate_hz": 5.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.2, "unit": "s", "min": 0.1, "max": 60.0, "description": "Time between two measurements"}, {"name": "tare_g", "type": "float", "default": 0.0, "unit": "g", "min": -5000.0, "max": 5000.0, "description": "Weight of the empty pan; taken off"}, {"name": "calibration", "type": "float", "default": 1.0, "unit": "", "min": 0.1, "max": 10.0, "description": "Times this"}]','msbot library, HX711.toml','6ee2aeaafb6bd4ed5775973b934931f96757dbe83fc057b1198e48b5614c31f0','');
INSERT INTO "library" VALUES('INA219','Battery monitor','Texas Instruments','Measures voltage and current of a battery and says how full it is','3.3 to 5V; battery to 26V','4 mV, 0.1 mA','[]','[{"name": "battery", "direction": "publish", "type": "Battery", "rate_hz": 1.0, "safe": null}, {"name": "low", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 1.0, "unit": "s", "min": 0.05, "max": 3600.0, "description": "Time between two measurements"}, {"name": "empty_v", "type": "float", "default": 6.4, "unit": "V", "min": 0.0, "max": 26.0, "description": "Voltage of the empty battery"}, {"name": "full_v", "type": "float", "default": 8.4, "unit": "V", "min": 0.0, "max": 26.0, "description": "Voltage of the full battery"}, {"name": "low_at", "type": "float", "default": 20.0, "unit": "%", "min": 0.0, "max": 100.0, "description": "Below this it counts as nearly empty"}]','msbot library, INA219.toml','99fe4f30ddeaef7115f6e5f49f7d63f078f25b74f5076c458d1493888470fb83','');
INSERT INTO "library" VALUES('KEYPAD-4X4','Keypad of 16 keys','any','Says which key is pressed and let go','3.3 to 5V','','[]','[{"name": "key", "direction": "publish", "type": "Key", "rate_hz": 0.0, "safe": null}]','[]','msbot library, KEYPAD-4X4.toml','99b3ebdf0fb37ffd55c3262d703dc66d465bc955d86936decddbe66493ea972a','');
INSERT INTO "library" VALUES('KY-023','Joystick','any','Says where its stick is and whether it is pressed','3.3 to 5V','10 bit','[]','[{"name": "stick", "direction": "publish", "type": "Stick", "rate_hz": 10.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.1, "unit": "s", "min": 0.02, "max": 60.0, "description": "Time between two measurements"}, {"name": "dead_zone", "type": "float", "default": 2.0, "unit": "%", "min": 0.0, "max": 50.0, "description": "Says nothing new until it has moved by so much"}, {"name": "swap_y", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Forwards is backwards"}]','msbot library, KY-023.toml','1a539447c1de8aa48073b8f17fba130befb9c340941e0bb904ec222aca392b73','');
INSERT INTO "library" VALUES('KY-025','Door contact (reed switch)','any','Notices a magnet, for example on a door','3.3 to 5V','','[]','[{"name": "closed", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Take on for off and off for on"}, {"name": "repeat_s", "type": "float", "default": 5.0, "unit": "s", "min": 0.0, "max": 3600.0, "description": "Says how it is that often; 0 = only when it changes"}]','msbot library, KY-025.toml','962f990a805f98c34c132bd5831ccbb69aa173d1f13c36930d8bb38b5405fc38','');
INSERT INTO "library" VALUES('KY-032','Obstacle sensor','any','Notices a thing that is nearer than about 10 cm','3.3 to 5V','','[]','[{"name": "near", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Take on for off and off for on"}, {"name": "repeat_s", "type": "float", "default": 5.0, "unit": "s", "min": 0.0, "max": 3600.0, "description": "Says how it is that often; 0 = only when it changes"}]','msbot library, KY-032.toml','ad88344a3e6f2bd2a469f3d2b18d21425ba95403c2e478465191fd3a10490b08','');
INSERT INTO "library" VALUES('KY-037','Microphone for loudness','any','Says how loud it is, and when there is a clap','3.3 to 5V','10 bit','[]','[{"name": "level", "direction": "publish", "type": "Level", "rate_hz": 10.0, "safe": null}, {"name": "loud", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.1, "unit": "s", "min": 0.02, "max": 60.0, "description": "Time between two measurements"}, {"name": "threshold", "type": "float", "default": 60.0, "unit": "%", "min": 0.0, "max": 100.0, "description": "Louder than this counts as loud"}]','msbot library, KY-037.toml','f157cd3a4c4c10df05ee19aa1d3f13141f62c22e077f05071895e8a1eeab263c','');
INSERT INTO "library" VALUES('KY-040','Turning knob with clicks','any','Counts the clicks of its knob; it can be pressed, too','3.3 to 5V','20 clicks a turn','[]','[{"name": "count", "direction": "publish", "type": "Count", "rate_hz": 0.0, "safe": null}, {"name": "pressed", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Count the other way round"}]','msbot library, KY-040.toml','7115e631242650d79be2824d26b723b840198039d49300f7624b7829af73a1ed','');
INSERT INTO "library" VALUES('L298N','Driver for two motors','STMicroelectronics','Drives two motors forwards and backwards','5 to 35V, 2A','','[]','[{"name": "left", "direction": "subscribe", "type": "Level", "rate_hz": 0.0, "safe": {"percent": 0.0}}, {"name": "right", "direction": "subscribe", "type": "Level", "rate_hz": 0.0, "safe": {"percent": 0.0}}]','[{"name": "invert_left", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "The left motor is mounted the other way round"}, {"name": "invert_right", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "The right motor is mounted the other way round"}, {"name": "most", "type": "float", "default": 100.0, "unit": "%", "min": 0.0, "max": 100.0, "description": "Never gives a motor more than this"}, {"name": "ramp", "type": "float", "default": 400.0, "unit": "%/s", "min": 10.0, "max": 10000.0, "description": "Most change of power in a second"}]','msbot library, L298N.toml','1fb1c646d20a428c6eb515ba0b225651a31def9e51ddf85c650f85be82b8abb7','');
INSERT INTO "library" VALUES('LCD1602','Display, 2 lines of 16 characters','any','Shows a text in two lines','5V','','[]','[{"name": "text", "direction": "subscribe", "type": "Text", "rate_hz": 0.0, "safe": {"text": ""}}]','[{"name": "backlight", "type": "bool", "default": true, "unit": "", "min": null, "max": null, "description": "Whether it is lit from behind"}]','msbot library, LCD1602.toml','2badaf090f8ed7e137cec9cabdbb8895e3dbee54156ea6ab43a22a20d89d847f','');
INSERT INTO "library" VALUES('LED','Lamp (LED)','any','Shines while it is switched on','3.3 to 5V','','[]','[{"name": "on", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}]','[{"name": "brightness", "type": "float", "default": 100.0, "unit": "%", "min": 0.0, "max": 100.0, "description": "How brightly it shines"}]','msbot library, LED.toml','5405b598c9dcd08e165ff8ca062a0ea87bb464231ff3229b5821ce35b7635888','');
INSERT INTO "library" VALUES('LM393-SPEED','Wheel encoder','any','Counts the pulses of a turning wheel and says how quickly it turns','3.3 to 5V','20 pulses a turn','[]','[{"name": "count", "direction": "publish", "type": "Count", "rate_hz": 10.0, "safe": null}, {"name": "speed", "direction": "publish", "type": "Speed", "rate_hz": 10.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.1, "unit": "s", "min": 0.02, "max": 60.0, "description": "Time between two measurements"}, {"name": "pulses_per_turn", "type": "int", "default": 20, "unit": "", "min": 1.0, "max": 10000.0, "description": "Slots of the disc"}, {"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Count the other way round"}]','msbot library, LM393-SPEED.toml','cc619a41b867ac7481832b2037b9f4a85736f5b0c08ab3f628dd5ea261fbe54b','');
INSERT INTO "library" VALUES('MG90S','Servo with metal gear, 180 degrees','Tower Pro','Turns an arm to an angle and holds it there','5V, 2.2 kg cm','1 degree','["SG90"]','[{"name": "angle", "direction": "subscribe", "type": "Angle", "rate_hz": 0.0, "safe": {"degrees": 90.0}}]','[{"name": "min_angle", "type": "float", "default": 0.0, "unit": "deg", "min": 0.0, "max": 180.0, "description": "Never turns below this"}, {"name": "max_angle", "type": "float", "default": 180.0, "unit": "deg", "min": 0.0, "max": 180.0, "description": "Never turns above this"}, {"name": "speed", "type": "float", "default": 600.0, "unit": "deg/s", "min": 1.0, "max": 600.0, "description": "How quickly it turns"}, {"name": "trim", "type": "float", "default": 0.0, "unit": "deg", "min": -30.0, "max": 30.0, "description": "Added to every angle, to set the arm straight"}]','msbot library, MG90S.toml','a2ea2dccc06e790b654987b52081ad324853975e7909f7efb6753e9a29e66d9c','');
INSERT INTO "library" VALUES('MG996R','Strong servo, 180 degrees','Tower Pro','Turns an arm to an angle and holds it there','6V, 11 kg cm','1 degree','["MG90S", "SG90"]','[{"name": "angle", "direction": "subscribe", "type": "Angle", "rate_hz": 0.0, "safe": {"degrees": 90.0}}]','[{"name": "min_angle", "type": "float", "default": 0.0, "unit": "deg", "min": 0.0, "max": 180.0, "description": "Never turns below this"}, {"name": "max_angle", "type": "float", "default": 180.0, "unit": "deg", "min": 0.0, "max": 180.0, "description": "Never turns above this"}, {"name": "speed", "type": "float", "default": 350.0, "unit": "deg/s", "min": 1.0, "max": 350.0, "description": "How quickly it turns"}, {"name": "trim", "type": "float", "default": 0.0, "unit": "deg", "min": -30.0, "max": 30.0, "description": "Added to every angle, to set the arm straight"}]','msbot library, MG996R.toml','1ecfbf6a9edfc734fc76c71bd45bdae1a36072b195d474fccbf5ab8c18129686','');
INSERT INTO "library" VALUES('MPU-6050','Motion sensor (IMU)','InvenSense','Measures acceleration and rate of turn along three axes','3.3 to 5V','16 bit','[]','[{"name": "acceleration", "direction": "publish", "type": "Vector", "rate_hz": 20.0, "safe": null}, {"name": "rotation", "direction": "publish", "type": "Vector", "rate_hz": 20.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.05, "unit": "s", "min": 0.02, "max": 10.0, "description": "Time between two measurements"}]','msbot library, MPU-6050.toml','21604af3c92b0b98f876a828307e22eeba756ec8edf63edc27b398f23a96b7b6','');
INSERT INTO "library" VALUES('MQ-2','Gas and smoke sensor','Winsen','Measures gas and smoke in the air, and warns of them','5V, warms up for 20 s','10 bit','[]','[{"name": "gas", "direction": "publish", "type": "Gas", "rate_hz": 2.0, "safe": null}, {"name": "alarm", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.5, "unit": "s", "min": 0.1, "max": 60.0, "description": "Time between two measurements"}, {"name": "alarm_at", "type": "float", "default": 1000.0, "unit": "ppm", "min": 0.0, "max": 10000.0, "description": "Warns when there is more than this"}]','msbot library, MQ-2.toml','33ef1dc8ea50fd5d783faa467b56a3dbce0f3dc9af85909596c0591cc02ebdf5','');
INSERT INTO "library" VALUES('NEO-6M','GPS receiver','u-blox','Says where on Earth it is','3.3 to 5V','2.5 m','[]','[{"name": "place", "direction": "publish", "type": "Place", "rate_hz": 1.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 1.0, "unit": "s", "min": 0.2, "max": 3600.0, "description": "Time between two measurements"}]','msbot library, NEO-6M.toml','c4233d0a7c290efba04e87909edea04ff40a0d4261752f59add58d5761b22751','');
INSERT INTO "library" VALUES('NUMATO-8','USB module with 8 inputs and outputs','Numato Lab','Eight pins; each can be switched, or read as an input','5V (USB); 3.3V pins','','[]','[{"name": "out_0", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}, {"name": "out_1", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}, {"name": "out_2", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}, {"name": "out_3", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}, {"name": "out_4", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}, {"name": "out_5", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}, {"name": "out_6", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}, {"name": "out_7", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}, {"name": "in_0", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}, {"name": "in_1", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}, {"name": "in_2", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}, {"name": "in_3", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}, {"name": "in_4", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}, {"name": "in_5", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}, {"name": "in_6", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}, {"name": "in_7", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "repeat_s", "type": "float", "default": 10.0, "unit": "s", "min": 0.0, "max": 3600.0, "description": "Says how its inputs stand that often; 0 = only when one changes"}]','msbot library, NUMATO-8.toml','475fb2b59f0b87d4522b1603041de14e5f4a4701299e3653f0a502cd6c7af5b9','');
INSERT INTO "library" VALUES('POT-10K','Potentiometer, 10 kilo-ohm','any','Says how far its knob is turned','3.3 to 5V','10 bit','[]','[{"name": "level", "direction": "publish", "type": "Level", "rate_hz": 10.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.1, "unit": "s", "min": 0.02, "max": 60.0, "description": "Time between two measurements"}, {"name": "change", "type": "float", "default": 0.5, "unit": "%", "min": 0.0, "max": 100.0, "description": "Says nothing until it has turned by so much"}]','msbot library, POT-10K.toml','71ff43274612456c3651e38d0fd49b7650f97d9019f64e476dfafcf6018b21be','');
INSERT INTO "library" VALUES('QTR-8A','Line follower, 8 sensors','Pololu','Says where a dark line is below it','5V','0.01','[]','[{"name": "line", "direction": "publish", "type": "Line", "rate_hz": 50.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.02, "unit": "s", "min": 0.02, "max": 10.0, "description": "Time between two measurements"}, {"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "The sensor looks backwards: left is right"}]','msbot library, QTR-8A.toml','760343ec1e24942e6ea66dc29b0bba500263ccac7d21beaa1fcb6b8302bc581c','');
INSERT INTO "library" VALUES('RELAY-1','Relay, one contact','any','Opens and closes a contact','5V; contact 10 A','','[]','[{"name": "on", "direction": "subscribe", "type": "Switch", "rate_hz": 0.0, "safe": {"on": false}}]','[{"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "What is connected hangs on the contact that opens"}]','msbot library, RELAY-1.toml','84ee72384175f858b70878c0dc3ba0c6a47b2d7f9412876441499bc31b1d563c','');
INSERT INTO "library" VALUES('RGB-LED','Colour lamp (RGB LED)','any','Shines in the colour that it is told','3.3 to 5V','','[]','[{"name": "colour", "direction": "subscribe", "type": "Colour", "rate_hz": 0.0, "safe": {"red": 0, "green": 0, "blue": 0}}]','[{"name": "brightness", "type": "float", "default": 1.0, "unit": "", "min": 0.0, "max": 1.0, "description": "Share of the full brightness"}]','msbot library, RGB-LED.toml','650f8a31444e507d3e2b80ccdca6bdeaf07a500b78fea6990bfc112e017b56dc','');
INSERT INTO "library" VALUES('SG90','Servo, 180 degrees','Tower Pro','Turns an arm to an angle and holds it there','5V, 1.8 kg cm','1 degree','[]','[{"name": "angle", "direction": "subscribe", "type": "Angle", "rate_hz": 0.0, "safe": {"degrees": 90.0}}]','[{"name": "min_angle", "type": "float", "default": 0.0, "unit": "deg", "min": 0.0, "max": 180.0, "description": "Never turns below this"}, {"name": "max_angle", "type": "float", "default": 180.0, "unit": "deg", "min": 0.0, "max": 180.0, "description": "Never turns above this"}, {"name": "speed", "type": "float", "default": 600.0, "unit": "deg/s", "min": 1.0, "max": 600.0, "description": "How quickly it turns"}, {"name": "trim", "type": "float", "default": 0.0, "unit": "deg", "min": -30.0, "max": 30.0, "description": "Added to every angle, to set the arm straight"}]','msbot library, SG90.toml','a8f9b05a644ecd43c984f50961ef87344ac7bf7d3066015feeadb93895b209bb','');
INSERT INTO "library" VALUES('SOIL','Moisture sensor for soil','any','Says how moist the soil of a plant is','3.3 to 5V','10 bit','[]','[{"name": "moisture", "direction": "publish", "type": "Level", "rate_hz": 1.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 1.0, "unit": "s", "min": 0.1, "max": 60.0, "description": "Time between two measurements"}]','msbot library, SOIL.toml','21480112123a4ff396cafb5cf4ad06cd79f11c3edd86a27b69123738240642bd','');
INSERT INTO "library" VALUES('SSD1306','OLED display, 128 x 64 dots','Solomon Systech','Shows a text in eight lines','3.3 to 5V','128 x 64','["LCD1602"]','[{"name": "text", "direction": "subscribe", "type": "Text", "rate_hz": 0.0, "safe": {"text": ""}}]','[{"name": "brightness", "type": "float", "default": 100.0, "unit": "%", "min": 1.0, "max": 100.0, "description": "How brightly its dots shine"}, {"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Dark letters on a bright ground"}]','msbot library, SSD1306.toml','7fe12f00ef8c75ce5f8d36dab473cbcfa0e8dc4f29365aeef566186745940eb6','');
INSERT INTO "library" VALUES('TB6612FNG','Driver for two motors, small','Toshiba','Drives two motors forwards and backwards','2.5 to 13.5V, 1.2A','','["L298N"]','[{"name": "left", "direction": "subscribe", "type": "Level", "rate_hz": 0.0, "safe": {"percent": 0.0}}, {"name": "right", "direction": "subscribe", "type": "Level", "rate_hz": 0.0, "safe": {"percent": 0.0}}]','[{"name": "invert_left", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "The left motor is mounted the other way round"}, {"name": "invert_right", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "The right motor is mounted the other way round"}, {"name": "most", "type": "float", "default": 100.0, "unit": "%", "min": 0.0, "max": 100.0, "description": "Never gives a motor more than this"}, {"name": "ramp", "type": "float", "default": 400.0, "unit": "%/s", "min": 10.0, "max": 10000.0, "description": "Most change of power in a second"}]','msbot library, TB6612FNG.toml','fa1a92e5302247e7b2856f903c470356f1c3b6a297e09a97572986490be297f5','');
INSERT INTO "library" VALUES('TCS34725','Colour sensor','ams','Measures colour and brightness of what is in front of it','3.3 to 5V','8 bit','[]','[{"name": "colour", "direction": "publish", "type": "Colour", "rate_hz": 5.0, "safe": null}, {"name": "light", "direction": "publish", "type": "Light", "rate_hz": 5.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.2, "unit": "s", "min": 0.05, "max": 60.0, "description": "Time between two measurements"}]','msbot library, TCS34725.toml','5958950879b30201ad82c7f38bd9e6471efd57c0daf08360efde9cdbb0167db9','');
INSERT INTO "library" VALUES('TOGGLE','Toggle switch','any','Says at once when it is switched, and now and then how it stands','3.3 to 5V','','[]','[{"name": "on", "direction": "publish", "type": "Switch", "rate_hz": 0.0, "safe": null}]','[{"name": "invert", "type": "bool", "default": false, "unit": "", "min": null, "max": null, "description": "Take on for off and off for on"}, {"name": "repeat_s", "type": "float", "default": 5.0, "unit": "s", "min": 0.0, "max": 3600.0, "description": "Says how it stands that often; 0 = only when switched"}]','msbot library, TOGGLE.toml','8b9636ed98659042152e15d205d6335549351cb1079f034fa65a621781af41d9','');
INSERT INTO "library" VALUES('VL53L0X','Laser range sensor (time of flight)','STMicroelectronics','Measures the distance to the next thing by the time light takes, 3 cm to 2 m','2.8 to 5V','1 mm','["HC-SR04"]','[{"name": "distance", "direction": "publish", "type": "Distance", "rate_hz": 20.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 0.05, "unit": "s", "min": 0.02, "max": 60.0, "description": "Time between two measurements"}, {"name": "offset_m", "type": "float", "default": 0.0, "unit": "m", "min": -1.0, "max": 1.0, "description": "Added to each measurement, for example when the sensor stands back"}]','msbot library, VL53L0X.toml','58db889a6a3d247fe273c1bdfdc0ca87d72bf3059f184ee2115d224d8d3dc18d','');
INSERT INTO "library" VALUES('WS2812B-8','Strip of 8 colour lamps','Worldsemi','Shows one colour on as many lamps as it is told','5V','','[]','[{"name": "colour", "direction": "subscribe", "type": "Colour", "rate_hz": 0.0, "safe": {"red": 0, "green": 0, "blue": 0}}, {"name": "lamps", "direction": "subscribe", "type": "Count", "rate_hz": 0.0, "safe": {"value": 0}}]','[{"name": "brightness", "type": "float", "default": 0.5, "unit": "", "min": 0.0, "max": 1.0, "description": "Share of the full brightness"}]','msbot library, WS2812B-8.toml','2fd13987c0ab7c3678e4bb1478c66c5dae1bc6a8f1d9cc07471b728a886401ba','');
INSERT INTO "library" VALUES('WXYZ','Motor driver','MASSEY_ENGINEERING_DEP','Drives a motor; in the sample robot it reports a random value from 0 to 7','5V','tbd','[]','[{"name": "out", "direction": "publish", "type": "HelloWorld", "rate_hz": 1.0, "safe": null}, {"name": "in", "direction": "subscribe", "type": "HelloWorld", "rate_hz": 1.0, "safe": null}]','[]','msbot library, WXYZ.toml','cb81efaf2f6820fd9622ef39788aac3ded40c0e50415cf5cdda35d8c929d9fc5','');
INSERT INTO "library" VALUES('DIAL','Dial','','','','','["ABCD"]','[{"name": "out", "direction": "publish", "type": "HelloWorld", "rate_hz": 0.0, "safe": null}, {"name": "in", "direction": "subscribe", "type": "HelloWorld", "rate_hz": 0.0, "safe": null}]','[{"name": "period_s", "type": "float", "default": 1.0, "unit": "s", "min": 0.1, "max": 10.0, "description": ""}]','/tmp/tmp_mjisi8z/DIAL.toml','19884e7f024fd10eec55176d4a6c79933dbfbadbd85c8857dd2d8dfea9fc332f','');
CREATE TABLE node_ids (
	robot_id INTEGER NOT NULL, 
	link TEXT NOT NULL, 
	node_id INTEGER NOT NULL, 
	uid TEXT NOT NULL, 
	kept_ns BIGINT NOT NULL, 
	CONSTRAINT pk_node_ids PRIMARY KEY (robot_id, link, node_id), 
	CONSTRAINT fk_node_ids_robot_id FOREIGN KEY(robot_id) REFERENCES robots (id) ON DELETE CASCADE, 
	CONSTRAINT uq_node_ids_robot_id UNIQUE (robot_id, link, uid)
);
CREATE TABLE "parts" (
	robot_id INTEGER NOT NULL, 
	identity TEXT NOT NULL, 
	uid TEXT NOT NULL, 
	part_number TEXT NOT NULL, 
	local_name TEXT NOT NULL, 
	slot_id INTEGER, 
	state TEXT NOT NULL, 
	reason TEXT NOT NULL, 
	address TEXT NOT NULL, 
	first_seen_ns BIGINT NOT NULL, 
	changed_ns BIGINT NOT NULL, 
	placed_slot_id INTEGER, 
	CONSTRAINT pk_parts PRIMARY KEY (robot_id, identity), 
	CONSTRAINT fk_parts_slot_id FOREIGN KEY(slot_id) REFERENCES slots (id) ON DELETE SET NULL, 
	CONSTRAINT fk_parts_robot_id FOREIGN KEY(robot_id) REFERENCES robots (id) ON DELETE CASCADE, 
	CONSTRAINT fk_parts_placed_slot_id FOREIGN KEY(placed_slot_id) REFERENCES slots (id) ON DELETE SET NULL
);
INSERT INTO "parts" VALUES(1,'6669727374205549','6669727374205549','DIAL','one',1,'checking','','',1700000003000000000,1700000003000000000,NULL);
INSERT INTO "parts" VALUES(1,'7365636f6e645549','7365636f6e645549','EFGH','two',2,'checking','','',1700000004000000000,1700000007000000000,2);
CREATE TABLE robots (
	id INTEGER NOT NULL, 
	name TEXT NOT NULL, 
	serial_number TEXT NOT NULL, 
	version TEXT NOT NULL, 
	released TEXT NOT NULL, 
	manufacturer TEXT NOT NULL, 
	beat_period_s DOUBLE NOT NULL, 
	tick_period_s DOUBLE NOT NULL, 
	life INTEGER NOT NULL, 
	profile_period_s DOUBLE NOT NULL, 
	"explain" BOOLEAN NOT NULL, 
	free_topics JSON NOT NULL, 
	applied_ns BIGINT NOT NULL, authentication TEXT DEFAULT 'open' NOT NULL, 
	CONSTRAINT pk_robots PRIMARY KEY (id), 
	CONSTRAINT uq_robots_name UNIQUE (name, serial_number)
);
INSERT INTO "robots" VALUES(1,'MSBOT_MASTER','X100Y100Z100','MSBOT_V1','8-4-2021','MASSEY_ENGINEERING_DEP',1.0,2.0,3,5.0,0,'[]',1700000011000000000,'open');
CREATE TABLE settings (
	slot_id INTEGER NOT NULL, 
	name TEXT NOT NULL, 
	origin TEXT NOT NULL, 
	value JSON NOT NULL, 
	changed_ns BIGINT NOT NULL, who TEXT DEFAULT '' NOT NULL, 
	CONSTRAINT pk_settings PRIMARY KEY (slot_id, name, origin), 
	CONSTRAINT fk_settings_slot_id FOREIGN KEY(slot_id) REFERENCES slots (id) ON DELETE CASCADE
);
INSERT INTO "settings" VALUES(1,'period_s','library',1,1700000001000000000,'');
INSERT INTO "settings" VALUES(1,'period_s','hand',2.5,1700000013000000000,'Bob');
CREATE TABLE slots (
	id INTEGER NOT NULL, 
	robot_id INTEGER NOT NULL, 
	name TEXT NOT NULL, 
	position INTEGER NOT NULL, 
	part_number TEXT NOT NULL, 
	local_name TEXT NOT NULL, 
	description TEXT NOT NULL, 
	in_blueprint BOOLEAN NOT NULL, 
	configuration_version INTEGER NOT NULL, 
	CONSTRAINT pk_slots PRIMARY KEY (id), 
	CONSTRAINT fk_slots_robot_id FOREIGN KEY(robot_id) REFERENCES robots (id) ON DELETE CASCADE, 
	CONSTRAINT uq_slots_robot_id UNIQUE (robot_id, name)
);
INSERT INTO "slots" VALUES(1,1,'AA',0,'DIAL','ABCD-local','Sees the sun',1,4);
INSERT INTO "slots" VALUES(2,1,'BB',1,'EFGH','EFGH-local','Toggle switch, 5V',1,3);
INSERT INTO "slots" VALUES(3,1,'CC',2,'WXYZ','WXYZ-local','Motor driver, 5V',1,1);
CREATE TABLE users (
	name TEXT NOT NULL, 
	role TEXT NOT NULL, 
	password_hash TEXT NOT NULL, 
	token_hashes JSON NOT NULL, 
	created_ns BIGINT NOT NULL, 
	changed_ns BIGINT NOT NULL, 
	CONSTRAINT pk_users PRIMARY KEY (name)
);
CREATE INDEX ix_journal_robot_id ON journal (robot_id, id);
CREATE INDEX ix_bindings_robot_id ON bindings (robot_id);
CREATE INDEX ix_parts_slot_id ON parts (slot_id);
CREATE INDEX ix_edits_robot_id ON edits (robot_id, id);
COMMIT;
