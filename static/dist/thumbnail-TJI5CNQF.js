import{a,b}from"./chunk-DVEIMA2A.js";import"./chunk-LSQKN36D.js";import"./chunk-4ZK5IQMA.js";import"./chunk-YSZMC7RV.js";import"./chunk-F7OM52AD.js";export{a as drawThumbnail,b as drawTurned};
